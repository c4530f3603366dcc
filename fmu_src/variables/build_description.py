"""Renders sources/buildDescription.xml: how to compile an FMU from its sources.  The format is that of FMI 3.0."""

from __future__ import annotations

from xml.etree import ElementTree as XML

from .described import add_files

#: What buildDescription.xml says about compilers.
COMPILERS = (
    "ISO C99, and C++11 at the same time, for any compiler. GCC and Clang use their vectors unless TS_PLAIN_C is defined; "
    "the results are the same to the last bit where products are not fused with sums (GCC: -std=c99 or -ffp-contract=off). "
    "To link several such FMUs into one program, define FMI{version}_FUNCTION_PREFIX for each."
)


def build_description(identifier: str, sources: tuple[str, ...], version: int = 2) -> bytes:
    """sources/buildDescription.xml: how to compile the FMU from its sources, for tools that know this format of FMI 3.0.

    version: of the standard that the FMU follows, 2 or 3.
    """
    root = XML.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = XML.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    configuration.set("description", COMPILERS.format(version=version))
    add_files(XML.SubElement(configuration, "SourceFileSet", language="C99"), "SourceFile", sources)
    XML.SubElement(configuration, "Library", name="m", external="true", description="mathematical functions of C, on Unix")
    XML.indent(root)
    return XML.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"

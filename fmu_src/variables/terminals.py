"""Renders terminalsAndIcons/terminalsAndIcons.xml: what belongs together at a node or a string, for tools that connect by it.

The format is that of FMI 3.0.  FMI 2.0 tools that do not know it pass it over.
"""

from __future__ import annotations

from xml.etree import ElementTree as XML

from tensegrity_core.model import Model

from .arrays import Whole, wholes
from .interface import Variable, variables

#: Fields by kind of terminal: forces with positions at a node, rest length with tension at a string.
MEMBERS = {
    "node": ("force", "position", "velocity", "reaction", "node_position", "node_velocity", "node_acceleration"),
    "string": ("rest_length", "rest_length_rate", "current", "wound_rest_length", "string_force", "string_length"),
}
PATH = "terminalsAndIcons/terminalsAndIcons.xml"


def terminals(model: Model, table: tuple[Variable, ...], fmi3: bool = False) -> bytes | None:
    """The XML document, or None where it would say nothing: the format has no empty list.  table: the FMU's variables, of
    any naming; fmi3: with arrays as members, and where the icon stands."""
    root = XML.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    if fmi3:
        _add_icon(root)
    listed = XML.SubElement(root, "Terminals")
    kinds = dict.fromkeys(model.node_names, "node") | dict.fromkeys(model.string_names, "string")
    found: dict[str, list[tuple[str, str]]] = {name: [] for name in kinds}
    named = variables(model)
    structured = {one.reference: one.name for one in (wholes(named) if fmi3 else named)}
    for one in wholes(table) if fmi3 else table:
        row = one.first if isinstance(one, Whole) else one
        component, _, member = structured.get(row.reference, "").partition(".")
        if component in kinds and row.field in MEMBERS[kinds[component]]:
            found[component].append((member, one.name))
    for name, members in ((name, members) for name, members in found.items() if members):
        what = {"terminalKind": kinds[name], "description": f"{kinds[name]} {name}"}
        terminal = XML.SubElement(listed, "Terminal", name=name, matchingRule="plug", attrib=what)
        for member, variable in members:
            XML.SubElement(terminal, "TerminalMemberVariable", variableName=variable, memberName=member, variableKind="signal")
    if not len(listed):
        root.remove(listed)
    if not len(root):
        return None
    XML.indent(root)
    return XML.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _add_icon(root: XML.Element) -> None:
    """The icon, a square, fills the coordinate system that tools take where none is said."""
    graphics = XML.SubElement(root, "GraphicalRepresentation")
    square = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    XML.SubElement(graphics, "CoordinateSystem", square | {"suggestedScalingFactorTo_mm": "0.1"})
    XML.SubElement(graphics, "Icon", square)

"""The winch and the controller as FMUs, compiled here: sources/*.c, and a table of variables from which the description and the
C header come.
"""

from __future__ import annotations

import hashlib
import subprocess
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

from fmu_src.packing.libraries import here
from fmu_src.packing.pack import write_zip
from fmu_src.variables.units import UNITS
from tensegrity_core.files import scratch, write_text
from tensegrity_core.native import build

SOURCES = Path(__file__).resolve().parent / "sources"
CHANNELS = (1, 2, 3)


class Variable(NamedTuple):
    """name: in FMI; constant: in C; causality: 'parameter', 'input', 'output'; rate_of: the variable whose rate it is."""

    name: str
    constant: str
    causality: str
    unit: str
    about: str
    start: float = 0.0
    rate_of: str = ""


class Block(NamedTuple):
    """name: of the FMU and of its C source; the value reference of a variable is its place."""

    name: str
    about: str
    variables: tuple[Variable, ...]


WINCH = Block(
    "winch",
    "A winch: its rest length follows a command with a lag, at a limited rate",
    (
        Variable("command", "COMMAND", "input", "m", "rest length that is asked for", 1.0),
        Variable("rest_length", "REST_LENGTH", "output", "m", "rest length of the string"),
        Variable("rest_length_rate", "REST_LENGTH_RATE", "output", "m/s", "its rate", rate_of="rest_length"),
        Variable("start_rest_length", "START_REST_LENGTH", "parameter", "m", "rest length at the start", 1.0),
        Variable("time_constant", "TIME_CONSTANT", "parameter", "s", "lag behind the command", 0.1),
        Variable("rate_limit", "RATE_LIMIT", "parameter", "m/s", "largest rate", 0.1),
    ),
)


def _channels(name: str, constant: str, *rest) -> tuple[Variable, ...]:
    return tuple(Variable(f"{name}[{i}]", f"{constant}_{i}", *rest) for i in CHANNELS)


CONTROLLER = Block(
    "controller",
    "Three PI controllers of heights by the rest lengths of strings that pull up",
    (
        *_channels("height", "HEIGHT", "input", "m", "measured height", 1.0),
        *_channels("command", "COMMAND", "output", "m", "rest length that is asked for"),
        *_channels("target", "TARGET", "parameter", "m", "height that is wanted", 1.0),
        *_channels("neutral", "NEUTRAL", "parameter", "m", "rest length that is asked for at the target", 1.0),
        Variable("gain", "GAIN", "parameter", "1", "rest length per deviation", 1.0),
        Variable("integral_gain", "INTEGRAL_GAIN", "parameter", "1/s", "rest length per deviation and time", 1.0),
        Variable("filter_time", "FILTER_TIME", "parameter", "s", "lag of the measurement", 0.01),
    ),
)


def pack(block: Block, destination: Path) -> Path:
    """Write a block's FMU, for the platform that runs this.  Raises RuntimeError where it cannot be compiled."""
    content = description(block).encode()
    with scratch() as folder:
        library = compiled(block, folder)
        files = {"modelDescription.xml": content, f"binaries/{here()}/{library.name}": library.read_bytes()}
        write_zip(destination, files)
    return destination


def compiled(block: Block, folder: Path) -> Path:
    """The block's library in a folder.  Raises RuntimeError with the compiler's words."""
    write_text(folder / "variables.h", header(block))
    library = folder / f"{block.name}{Path(build.FMU_LIBRARY).suffix}"
    sources = [str(SOURCES / f"{name}.c") for name in (block.name, "block")]
    options = ["-std=c99", "-O2", "-ffp-contract=off", "-shared", f"-I{folder}", f"-I{SOURCES}", f"-I{build.fmi_headers()}"]
    options += [] if library.suffix == ".dll" else ["-fPIC"]
    line = [*(build.system_compiler() or build.zig()), *options, *sources, "-o", str(library), "-lm"]
    done = subprocess.run(line, capture_output=True, text=True, errors="replace")
    if done.returncode:
        raise RuntimeError(f"{block.name}.c could not be compiled: {done.stderr[-1000:]}")
    return library


def identity(block: Block) -> str:
    """Stands for the content of sources and table."""
    digest = hashlib.sha256(repr(block).encode())
    for path in (SOURCES / "block.h", SOURCES / "block.c", SOURCES / f"{block.name}.c"):
        digest.update(path.read_bytes())
    return f"{{{digest.hexdigest()[:32]}}}"


def header(block: Block) -> str:
    """variables.h, see block.h."""
    constants = ", ".join(variable.constant for variable in block.variables)
    starts = ", ".join(repr(variable.start) for variable in block.variables)
    causalities = "".join(variable.causality[0] for variable in block.variables)
    return (
        f"enum {{ {constants}, VARIABLES }};\n#define STARTS {{{starts}}}\n"
        f'#define CAUSALITIES "{causalities}"\n#define IDENTITY "{identity(block)}"\n'
    )


def description(block: Block) -> str:
    """modelDescription.xml."""
    table, unknowns = block.variables, ""
    for index, variable in enumerate(table, 1):
        if variable.causality == "output":
            unknowns += f'<Unknown index="{index}" dependencies=""/>'
    given = " ".join(str(i) for i, variable in enumerate(table, 1) if variable.causality != "output")
    rows = "\n    ".join(scalar(table, index) for index in range(len(table)))
    initial = unknowns.replace('dependencies=""', f'dependencies="{given}"')
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{block.name}" guid="{identity(block)}" description={quoteattr(block.about)}
  variableNamingConvention="structured">
  <CoSimulation modelIdentifier="{block.name}" canHandleVariableCommunicationStepSize="true" canInterpolateInputs="true"
    maxOutputDerivativeOrder="1" canGetAndSetFMUstate="true"/>
  <UnitDefinitions>{"".join(unit(name) for name in sorted({variable.unit for variable in table}))}</UnitDefinitions>
  <ModelVariables>
    {rows}
  </ModelVariables>
  <ModelStructure>
    <Outputs>{unknowns}</Outputs>
    <InitialUnknowns>{initial}</InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def unit(name: str) -> str:
    base = {"1/s": {"s": -1}} | {known: found.base for known, found in UNITS.items()}
    powers = "".join(f' {symbol}="{power}"' for symbol, power in base[name].items())
    return f'<Unit name="{name}"><BaseUnit{powers}/></Unit>'


def scalar(table: tuple[Variable, ...], index: int) -> str:
    """A variable's element."""
    row = table[index]
    places = {variable.name: place for place, variable in enumerate(table, 1)}
    rate = f' derivative="{places[row.rate_of]}"' if row.rate_of else ""
    if row.causality == "output":
        head, start = 'initial="calculated"', ""
    else:
        head, start = ('variability="fixed"' if row.causality == "parameter" else 'variability="continuous"'), row.start
        start = f' start="{row.start!r}"'
    return (
        f'<ScalarVariable name="{row.name}" valueReference="{index}" causality="{row.causality}" {head} '
        f'description={quoteattr(row.about)}><Real unit="{row.unit}"{rate}{start}/></ScalarVariable>'
    )

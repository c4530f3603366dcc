"""The importers and checkers: where each comes from, and how it is called."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple


class Tool(NamedTuple):
    """name: for humans; packages: of PyPI, the first gives the version (numpy is there for the Python FMU); driver: a script in
    drivers/, or None where there is none yet; inputs: how the held inputs reach the FMU; debian: libraries that the packages
    lack; maven: an artifact that the driver calls; limit: why it cannot be had or refuses an FMU, as far as
    that was found out; fmus: which it is tried with, see scenario.PACK; limits: as limit, by those; crate: of crates.io, a
    program; command: a program that must be on the path."""

    name: str
    packages: tuple[str, ...]
    driver: str | None = None
    inputs: str = ""
    debian: tuple[str, ...] = ()
    maven: str = ""
    limit: str = ""
    fmus: tuple[str, ...] = ("native", "python")
    limits: Mapping[str, str] = MappingProxyType({})
    crate: str = ""
    command: str = ""

    def why_not(self, fmu: str) -> str:
        return self.limits.get(fmu, "") or self.limit


TBB = ("libtbb12", "libtbbmalloc2", "libtbbbind-2-5", "libhwloc15")
TABLE = "from a table with two rows at each jump"
SET = "set before each step"
REALS = "it reads every output by fmi2GetReal, Integer outputs too"
MAESTRO = "org.into-cps.maestro:maestro:2.3.0:jar:jar-with-dependencies"
COUPLED = "outputs of a second FMU, connected"
#: FMUs by standard and kind, beside the two of FMI 2.0 for co-simulation.
ME, THREE, THREE_ME = "native, model exchange", "native, FMI 3.0", "native, FMI 3.0, model exchange"
STEPPED = ("native", THREE, "python")
ALL = ("native", ME, THREE, THREE_ME, "python")
SIM = {ME: "it integrates by Euler steps", **dict.fromkeys((THREE, THREE_ME), "it knows no units of FMI 3.0's numbers")}
ONE = "it sets and reads one value at a reference, and there are arrays"

TOOLS = (
    Tool("fmpy validate", ("fmpy==0.3.32",), "fmpy_validate", fmus=ALL),
    Tool("FMU Manipulation Toolbox, fmutool -check", ("fmu-manipulation-toolbox==2.0",), "fmutool", fmus=ALL),
    Tool(
        "FMU Manipulation Toolbox, fmucontainer",
        ("fmu-manipulation-toolbox==2.0", "fmpy==0.3.32"),
        "container",
        "set before each step of the container, by fmpy",
        fmus=("native", THREE),
        limits={THREE: "it describes the starts of arrays as those of texts are"},
    ),
    Tool("fmpy simulate_fmu", ("fmpy==0.3.32",), "fmpy_simulate", TABLE, fmus=ALL),
    Tool("fmpy low-level calls", ("fmpy==0.3.32",), "fmpy_calls", SET, fmus=STEPPED),
    Tool(
        "libcosim (libcosimpy)",
        ("libcosimpy==0.0.6", "numpy"),
        "libcosim",
        "by the override manipulator before each step",
        fmus=STEPPED,
        limits={THREE: "it knows FMI 1.0 and 2.0"},
    ),
    Tool("libcosim (libcosimpy), coupled", ("libcosimpy==0.0.6", "numpy"), "libcosim", COUPLED),
    Tool("ecos (ecospy)", ("ecospy==0.7.2", "numpy"), "ecos", SET, TBB, fmus=STEPPED, limits={THREE: ONE}),
    Tool("ecos (ecospy), coupled", ("ecospy==0.7.2", "numpy"), "ecos", COUPLED, TBB),
    Tool("Maestro, coupled", (), "maestro", COUPLED, maven=MAESTRO, limit="it knows no parameters that are enumerations"),
    Tool(
        "gemseo-fmu",
        ("gemseo-fmu==3.1.1",),
        "gemseo_discipline",
        "given to each execution of the discipline",
        fmus=STEPPED,
        limits={THREE: "its steps are for FMI 2.0"},
    ),
    Tool(
        "PathSim (pathsim-fmi)",
        ("pathsim-fmi==0.1.1",),
        "pathsim_block",
        "from source blocks, one per input",
        fmus=ALL,
        limits={THREE: ONE, THREE_ME: ONE},
    ),
    Tool(
        "CoFmuPy",
        ("cofmupy==1.0.0",),
        "cofmu",
        "from literal streams, one per input",
        fmus=STEPPED,
        limits={THREE: "its fmpy does not read the types of this description"},
    ),
    Tool("CasADi, DaeBuilder", ("casadi==3.8.2", "numpy"), "casadi_builder", fmus=(ME, THREE_ME), limits={THREE_ME: ONE}),
    Tool(
        "fmi-sim",
        ("libclang==18.1.1",),
        "fmi_sim",
        "from a CSV file",
        fmus=("native", ME, THREE, THREE_ME),
        limits=SIM,
        crate="fmi-sim==0.7.0",
    ),
    Tool(
        "fmusim",
        (),
        "fmusim",
        "from a CSV file",
        limit="it is in no registry; its sources are github.com/modelica/fmusim",
        fmus=("native", ME, THREE, THREE_ME),
        limits={THREE_ME: "of model exchange it looks for the instance before it has stored it"},
        command="fmusim",
    ),
    Tool("PyFMI", ("PyFMI",), limit="no wheel on PyPI; a build from source needs FMI Library, which Debian has not"),
    Tool("OMSimulator", ("OMSimulator",), limit="no wheel on PyPI; its set-up downloads from build.openmodelica.org"),
    Tool("FMI++", ("fmipp",), limit="no wheel on PyPI; a build from source stops without SWIG"),
)

"""The importers and checkers: where each comes from, and how it is called."""

from __future__ import annotations

from typing import NamedTuple


class Tool(NamedTuple):
    """name: for humans; packages: of PyPI, the first gives the version (numpy is there for the Python FMU); driver: a script in
    drivers/, or None where there is none yet; inputs: how the held inputs reach the FMU; debian: libraries that the packages
    lack; maven: an artifact that the driver calls; limit: why it cannot be had or refuses an FMU, as far as
    that was found out."""

    name: str
    packages: tuple[str, ...]
    driver: str | None = None
    inputs: str = ""
    debian: tuple[str, ...] = ()
    maven: str = ""
    limit: str = ""


TBB = ("libtbb12", "libtbbmalloc2", "libtbbbind-2-5", "libhwloc15")
TABLE = "from a table with two rows at each jump"
SET = "set before each step"
REALS = "it reads every output by fmi2GetReal, Integer outputs too"
MAESTRO = "org.into-cps.maestro:maestro:2.3.0:jar:jar-with-dependencies"
COUPLED = "outputs of a second FMU, connected"

TOOLS = (
    Tool("fmpy validate", ("fmpy==0.3.32",), "fmpy_validate"),
    Tool("FMU Manipulation Toolbox, fmutool -check", ("fmu-manipulation-toolbox==2.0",), "fmutool"),
    Tool("fmpy simulate_fmu", ("fmpy==0.3.32",), "fmpy_simulate", TABLE),
    Tool("fmpy low-level calls", ("fmpy==0.3.32",), "fmpy_calls", SET),
    Tool("libcosim (libcosimpy)", ("libcosimpy==0.0.6", "numpy"), "libcosim", "by the override manipulator before each step"),
    Tool("libcosim (libcosimpy), coupled", ("libcosimpy==0.0.6", "numpy"), "libcosim", COUPLED),
    Tool("ecos (ecospy)", ("ecospy==0.7.2", "numpy"), "ecos", SET, TBB),
    Tool("ecos (ecospy), coupled", ("ecospy==0.7.2", "numpy"), "ecos", COUPLED, TBB),
    Tool("Maestro, coupled", (), "maestro", COUPLED, maven=MAESTRO, limit="it knows no parameters that are enumerations"),
    Tool("gemseo-fmu", ("gemseo-fmu==3.1.1",), "gemseo_discipline", "given to each execution of the discipline"),
    Tool("PathSim (pathsim-fmi)", ("pathsim-fmi==0.1.1",), "pathsim_block", "from source blocks, one per input", limit=REALS),
    Tool("CoFmuPy", ("cofmupy==1.0.0",), "cofmu", "from literal streams, one per input", limit=REALS),
    Tool("PyFMI", ("PyFMI",), limit="no wheel on PyPI; a build from source needs FMI Library, which Debian has not"),
    Tool("OMSimulator", ("OMSimulator",), limit="no wheel on PyPI; its set-up downloads from build.openmodelica.org"),
    Tool("FMI++", ("fmipp",), limit="no wheel on PyPI; a build from source stops without SWIG"),
)

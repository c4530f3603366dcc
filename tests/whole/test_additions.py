"""What docs/extending.md says of additions is true: in a copy of the tree an output, an input, a string law and an integrator
are added by these steps alone, the copy is built, and an FMU that has them is validated; and what is left half done is found.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.conftest import once

ROOT = Path(__file__).resolve().parents[2]
PARTS = ("tensegrity_core", "fmu_src", "build_fmu.py", "LICENSE", "pyproject.toml", "README.md")

#: The elongation of a string as an output: its row, and its values in the kernel and in the reference.
ROW = """    Field("elongation", "output", ("S",), "m", "{S}.elongation", "length beyond the rest length", compared="length"),
"""
KERNEL = "        sim->io.values[m->at[TS_ELONGATION] + i] = sim->strings.elongation[i];\n"
REFERENCE = "            elongation=strings.elongation,\n"

#: A uniform wind as an input, the same force on every free node: its row, and its effect in the kernel and in the reference.
WIND_ROW = """    Field("wind", "input", ("D",), "N", "wind.{D}", "force on each free node, held over a step", start=0.0),
"""
WIND_KERNEL = "    return inputs[m->at[TS_WIND] + d] + inputs[m->at[TS_FORCE] + free * m->count[TS_D] + d];\n"
WIND_REFERENCE = "    return load.force + load.wind * ~s.model.fixed\n"

#: A string that hardens, f = k x + c x^3: its class with its keys, its compilation, its exact form.
CLASS = """@dataclass(frozen=True)
class Hardening(_Numbers):
    k: float = key("stiffness at first in N/m", low=1e-15)
    c: float = key("how it hardens in N/m3", low=0.0)


"""
COMPILED = """    case TS_ELEMENT_HARDENING:
        if ((v = next_values(p, 2))) {
            double c[3] = {v[0], 0.0, v[1]};
            compile_polynomial(law, c, 3);
        }
        break;
"""
EXACT = """def _hardening(element) -> Law:
    return _leaf([Piece.of(PolynomialCurve(0.0, (0.0, element.k, 0.0, element.c), 0.0), 0.0, math.inf)])


"""

#: A scene that has it.
SCENE = """extends = "two_bar"
name = "hardening"

[elements.rubber]
kind = "hardening"
k = 1500.0
c = 4e5

[strings]
s3 = { element = "rubber" }
"""

#: Heun's method, K. Heun, Neue Methoden zur approximativen Integration der Differentialgleichungen einer unabhaengigen
#: Veraenderlichen, Zeitschrift fuer Mathematik und Physik 45, 1900: what differs from rk4.c, whose dense output it keeps.
LINE = '    "heun": "explicit Runge-Kutta method of order 2 by Heun, fixed step",\n'
ATTEMPT = """static double attempt(ts_sim *sim, double tau, double h)
{
    int stride = sim->m.stride, n = padded(2 * sim->m.nq);
    static const double middle[1] = {1.0}, end[2] = {0.5, 0.5};
    for (int i = 0; i < stride; i++) sim->attempt.k[i] = sim->start.f[i];
    add_stages(sim->state.y, middle, 1, sim->attempt.k, stride, h, n, sim->attempt.y);
    ts_rhs(sim, tau + h, sim->attempt.y, sim->attempt.k + stride);
    add_stages(sim->state.y, end, 2, sim->attempt.k, stride, h, stride, sim->ahead.y);
    return 0.0;
}

"""


def insert(path: Path, before: str, text: str) -> None:
    change(path, before, text + before)


def change(path: Path, before: str, after: str) -> None:
    old = path.read_text(encoding="utf-8")
    assert old.count(before) == 1, f"{path} holds {before!r} {old.count(before)} times"
    path.write_text(old.replace(before, after), encoding="utf-8")


def source(tree: Path, name: str) -> Path:
    (found,) = (tree / "tensegrity_core" / "native").rglob(name)
    return found


def run(tree: Path, *command, code: int = 0) -> str:
    """What a command of the copy prints; it imports the copy, which lies in the working folder."""
    surroundings = {**os.environ, "PYTHONPATH": str(tree), "XDG_CACHE_HOME": str(tree / "cache")}
    options = {"capture_output": True, "text": True, "encoding": "utf-8"}
    done = subprocess.run([sys.executable, *command], cwd=tree, env=surroundings, **options)
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


def build_libraries(tree: Path, *more: str) -> None:
    """What installing the package does, for the kernel, in less time, and what else is named.  Objects stay in the tree, and go
    along into its copies."""
    lines = ["from pathlib import Path", "from tensegrity_core.native import build", "build.FLAGS.append('-O1')"]
    lines += ["objects = Path('objects')", "build.compile_library(build.HERE, objects=objects)", *more]
    run(tree, "-c", "\n".join(lines))


def add_output(tree: Path) -> None:
    """Three files."""
    insert(tree / "tensegrity_core" / "fields.py", '    Field("wound_rest_length", ', ROW)
    insert(source(tree, "outputs.c"), "        force[i] = sim->strings.fs[i] + sim->strings.fd[i];\n", KERNEL)
    insert(tree / "tensegrity_core" / "reference" / "run.py", "            kinetic=instant.kinetic_energy(", REFERENCE)


RIGHT_KERNEL = "    return inputs[m->at[TS_FORCE] + free * m->count[TS_D] + d];\n"
RIGHT_REFERENCE = "    return load.force\n"


def add_input(tree: Path) -> None:
    """Three files."""
    insert(tree / "tensegrity_core" / "fields.py", '    Field("stiffness", ', WIND_ROW)
    change(source(tree, "kinematics.h"), RIGHT_KERNEL, WIND_KERNEL)
    change(tree / "tensegrity_core" / "reference" / "instant.py", RIGHT_REFERENCE, WIND_REFERENCE)


def add_law(tree: Path) -> None:
    """Four files."""
    change(tree / "tensegrity_core" / "fields.py", '"parallel", "series")', '"parallel", "series", "hardening")')
    path = tree / "tensegrity_core" / "model" / "elements.py"
    insert(path, "@dataclass(frozen=True)\nclass Parallel", CLASS)
    change(path, "Table | Parallel | Series\n", "Table | Parallel | Series | Hardening\n")
    insert(source(tree, "elements.c"), "    case TS_ELEMENT_TABLE:\n", COMPILED)
    path = tree / "tensegrity_core" / "laws" / "elements.py"
    insert(path, "def _polynomial(", EXACT)
    change(path, "Series: _series}", "Series: _series, KINDS['hardening']: _hardening}")


def add_integrator(tree: Path) -> None:
    """Two files."""
    insert(tree / "tensegrity_core" / "fields.py", '    "ros2": ', LINE)
    rk4 = source(tree, "rk4.c")
    text = rk4.read_text(encoding="utf-8").replace("rk4", "heun")
    begin, end = text.index("static double attempt"), text.index("static void densify")
    text = text[:begin] + ATTEMPT + text[end:]
    text = "".join(line for line in text.splitlines(keepends=True) if "heun_tableau" not in line or "include" not in line)
    rk4.with_name("heun.c").write_text(text, encoding="utf-8")


#: Additions, and how many files each touches.
ADDITIONS = {add_output: 3, add_input: 3, add_law: 4, add_integrator: 2}


def contents(tree: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in tree.rglob("*") if path.suffix in (".py", ".c", ".h", ".toml", ".json")}


@pytest.fixture(scope="module")
def tree(tmp_path_factory) -> Path:
    """A copy of the tree with all of them, built."""

    def make(folder):
        folder.mkdir()
        kept = shutil.ignore_patterns("*.so", "*.dll", "*.dylib", "__pycache__", "*.dist-info")
        for part in PARTS:
            copy = shutil.copytree if (ROOT / part).is_dir() else shutil.copy2
            copy(ROOT / part, folder / part, **({"ignore": kept} if (ROOT / part).is_dir() else {}))
        before = contents(folder)
        for add, files in ADDITIONS.items():
            add(folder)
            after = contents(folder)
            assert len({path for path in after if after[path] != before.get(path)}) == files
            before = after
        (folder / "hardening.toml").write_text(SCENE, encoding="utf-8")
        run(folder, "-m", "tensegrity_core.fields")
        build_libraries(folder, "build.compile_fmu_library(build.RUNTIME / build.FMU_LIBRARY, objects=objects)")

    return once(tmp_path_factory, "additions", make)


def test_an_fmu_with_all_of_them_is_validated(tree):
    """Output, input and method are there by their names, compared, and documented; law and input act."""
    told = run(tree, "build_fmu.py", "hardening.toml", "--output", "dist", "--runtime", "native", "--no-page")
    assert "4 of 4" in told, told
    with zipfile.ZipFile(tree / "dist" / "native" / "hardening.fmu") as archive:
        assert b"s1.elongation" in archive.read("documentation/index.html")
    code = (
        "from fmpy import read_model_description, simulate_fmu\n"
        "fmu = 'dist/native/hardening.fmu'\n"
        "known = {v.name: v for v in read_model_description(fmu).modelVariables}\n"
        "print(known['s1.elongation'].causality, known['s1.elongation'].unit, known['solver.method'].max)\n"
        "def run(**options):\n"
        "    start = {'n4.force.z': 5.0, 'wind.x': options.pop('wind', 0.0)}\n"
        "    start |= {f'solver.{name}': value for name, value in options.items()}\n"
        "    names = ['s1.elongation', 's3.elongation', 's3.elastic_force']\n"
        "    return simulate_fmu(fmu, stop_time=0.2, start_values=start, output=names)\n"
        "found = run()\n"
        "exact, u = found['s1.elongation'], found['s3.elongation']\n"
        "coarse, fine = (abs(run(method=5, step=h)['s1.elongation'] - exact).max() for h in (2e-4, 1e-4))\n"
        "blown = run(wind=3.0)['s1.elongation']\n"
        "print(3.5 < coarse / fine < 4.5, abs(exact).max() > 1e-4, abs(blown - exact).max() > 1e-5)\n"
        "law = 1500.0 * u + 4e5 * u**3\n"
        "print(known['wind.x'].causality, u.min() > 0.0, abs(found['s3.elastic_force'] - law).max() < 1e-9)\n"
    )
    lines = run(tree, "-c", code).splitlines()
    assert lines[-3:] == ["output m 7", "True True True", "input True True"], lines


def test_fmi_3_and_model_exchange_have_them_too(tree):
    """The input is a vector, and so an array, of which everything may depend; both kinds give the same."""
    options = ["--fmi", "3.0", "--kind", "both", "--output", "dist", "--no-validate", "--no-page"]
    run(tree, "build_fmu.py", "hardening.toml", *options)
    code = (
        "from fmpy import read_model_description, simulate_fmu\n"
        "from fmpy.validation import validate_fmu\n"
        "fmu = 'dist/both-fmi3/hardening.fmu'\n"
        "read = read_model_description(fmu)\n"
        "known = {v.name: v for v in read.modelVariables}\n"
        "depends = [known['wind'] in unknown.dependencies for unknown in read.outputs if unknown.variable.type == 'Float64']\n"
        "print(validate_fmu(fmu), known['wind'].shape, known['wind'].causality, all(depends), 's1.elongation' in known)\n"
        "names, ends = ['s1.elongation', 'n4.position'], []\n"
        "for kind in ('CoSimulation', 'ModelExchange'):\n"
        "    start = {'wind': [3.0, 0.0], 'n4.force': [0.0, 5.0]}\n"
        "    run = {'fmi_type': kind, 'stop_time': 0.2, 'relative_tolerance': 1e-9, 'output': names}\n"
        "    ends.append(simulate_fmu(fmu, start_values=start, **run)[-1])\n"
        "away = [abs(a - b) for a, b in zip(*(end['n4.position'] for end in ends))]\n"
        "print(max(away) < 1e-7, abs(ends[0]['s1.elongation'] - ends[1]['s1.elongation']) < 1e-7)\n"
    )
    lines = run(tree, "-c", code).splitlines()
    assert lines[-2:] == ["[] (2,) input True True", "True True"], lines


def wrong(tree: Path, tmp_path: Path, file: str, before: str, after: str) -> Path:
    """A copy of the tree with a change of one file."""
    copy = tmp_path / "tree"
    shutil.copytree(tree, copy, ignore=shutil.ignore_patterns("dist", "cache"))
    path = copy / file if "/" in file else source(copy, file)
    text = path.read_text(encoding="utf-8")
    assert text.count(before) == 1
    path.write_text(text.replace(before, after), encoding="utf-8")
    return copy


def judged(copy: Path, run_name: str) -> str:
    """What is said of an FMU of the copy that fails under one of the runs, the others left out."""
    code = (
        "import sys\nfrom fmu_src import build\nfrom fmu_src.builds import judgement\n"
        "from fmu_src.validation.trials import trials\n"
        "judgement.trials = lambda model: [one for one in trials(model) if one.name.startswith(sys.argv[1])]\n"
        "sys.exit(build.main('two_bar --output dist --runtime native --no-page'.split()))\n"
    )
    return run(copy, "-c", code, run_name, code=1)


def test_a_wrong_value_of_the_new_output_is_found(tree, tmp_path):
    """In the reference, here: the comparison does not know which one is right."""
    right = "elongation=strings.elongation"
    copy = wrong(tree, tmp_path, "tensegrity_core/reference/run.py", right, f"{right} * (1.0 + 1e-5)")
    told = judged(copy, "blows_0_1d")
    assert "elongation error" in told, told


def test_an_output_without_a_value_in_the_reference_is_found(tree, tmp_path):
    copy = wrong(tree, tmp_path, "tensegrity_core/reference/run.py", REFERENCE, "")
    told = judged(copy, "blows_0_1d")
    assert "'elongation' is missing" in told, told


def test_an_output_without_a_value_in_the_kernel_is_found(tree, tmp_path):
    copy = wrong(tree, tmp_path, "outputs.c", KERNEL, "")
    build_libraries(copy)
    code = (
        "from tensegrity_core.kernel import Kernel\nfrom tensegrity_core.scene import load_scene\n"
        "from tensegrity_core.statics import build_model\n"
        "Kernel(build_model(load_scene('two_bar'))).initialize()\n"
    )
    assert "is not a finite number" in run(copy, "-c", code, code=1)


def test_an_input_that_acts_in_the_kernel_alone_is_found(tree, tmp_path):
    copy = wrong(tree, tmp_path, "tensegrity_core/reference/instant.py", WIND_REFERENCE, RIGHT_REFERENCE)
    told = judged(copy, "drive")
    assert "force error" in told, told


def test_an_input_that_acts_in_the_reference_alone_or_has_no_row_is_found(tree, tmp_path):
    code = (
        "from tensegrity_core import kernel, reference\nfrom tensegrity_core.scene import load_scene\n"
        "from tensegrity_core.model import grid, held\nfrom tensegrity_core.statics import build_model\n"
        "model = build_model(load_scene('two_bar'))\n"
        "inputs = held(model, grid(0.01, 0.005), wind=lambda t: [5.0, 0.0, 0.0])\n"
        "one, other = (room.simulate(model, inputs).position for room in (kernel, reference))\n"
        "print(abs(one - other).max() > 1e-6)\n"
    )
    assert run(tree, "-c", code).split() == ["False"]
    copy = wrong(tree, tmp_path, "kinematics.h", WIND_KERNEL, RIGHT_KERNEL)
    build_libraries(copy)
    assert run(copy, "-c", code).split() == ["True"]
    change(source(copy, "kinematics.h"), RIGHT_KERNEL, WIND_KERNEL)
    change(copy / "tensegrity_core" / "fields.py", WIND_ROW, "")
    run(copy, "-m", "tensegrity_core.fields")
    assert "the length is wrong" in run(copy, "-c", code, code=1)
    with pytest.raises(AssertionError, match="TS_WIND"):
        build_libraries(copy)


def test_a_law_without_its_exact_form_is_found(tree, tmp_path):
    copy = wrong(tree, tmp_path, "tensegrity_core/laws/elements.py", ", KINDS['hardening']: _hardening}", "}")
    told = run(copy, "-m", "tensegrity_core", "check", "two_bar", code=1)
    assert "laws/elements.py makes other laws than those of the kinds" in told


def test_a_law_without_its_compilation_is_found(tree, tmp_path):
    copy = wrong(tree, tmp_path, "elements.c", COMPILED, "")
    build_libraries(copy)
    told = run(copy, "-m", "tensegrity_core", "simulate", "hardening.toml", code=2)
    assert "a force law is damaged" in told, told


def test_a_law_without_its_kind_is_found(tree, tmp_path):
    copy = wrong(tree, tmp_path, "tensegrity_core/fields.py", ', "hardening")', ")")
    assert "model/elements.py the classes" in run(copy, "-m", "tensegrity_core", "check", "two_bar", code=1)

"""Stand-alone actuators: the FMU against a closed form, and coupled with a structure against the actuator inside it."""

import zipfile

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.ssp.ssd import read_ssd
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp

from fmu_src.build import main
from fmu_src.packing.actuator import detached
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu
from fmu_src.validation.outside import Instance
from tensegrity_core.kernel import simulate
from tensegrity_core.model import grid, held
from tests.support.driven_scenes import MAST, built

PACKERS = {"python": pack_python_fmu, "native": pack_native_fmu}
VARIABLES = {"current", "tension", "rest_length", "rest_length_rate", "speed", "start_rest_length", "inertia", "damping"}


def opened(fmu, folder, **start):
    instance = Instance(read_model_description(str(fmu)), extract(str(fmu), unzipdir=str(folder)), logging=True)
    instance.start(**start)
    return instance


@pytest.mark.parametrize("runtime", PACKERS)
def test_actuator_follows_eq_8(runtime, tmp_path):
    """J delta'' + d delta' = k i - r T under a tension that is held over each step."""
    model = built(MAST)
    winch, motor = detached(model)[1]["s2"], model.actuator[1]
    fmu = PACKERS[runtime](winch, tmp_path / "winch.fmu")
    assert validate_fmu(str(fmu)) == []
    description = read_model_description(str(fmu))
    names = {v.name for v in description.modelVariables}
    assert VARIABLES | {"torque_constant", "radius", "solver.method"} <= names
    assert all(name.startswith(("solver.", "energy.")) for name in names if "." in name)
    rest = model.rest_length[1] + 0.25
    instance = opened(fmu, tmp_path / "winch", parameters={"start_rest_length": rest})
    assert instance.get("rest_length") == rest and instance.get("rest_length_rate") == 0.0
    turned = np.zeros(2)
    for k in range(20):
        current, tension = 1.0 + 0.3 * k, 20.0 - k
        instance.set({"current": current, "tension": tension})
        instance.fmu.doStep(0.05 * k, 0.05)

        def equation(t, y, current=current, tension=tension):
            torque = motor.torque_constant * current - motor.damping * y[1] - motor.radius * tension
            return [y[1], torque / motor.inertia]

        turned = solve_ivp(equation, (0.0, 0.05), turned, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
        found = instance.get("rest_length", "rest_length_rate", "speed")
        np.testing.assert_allclose(found, [rest - motor.radius * turned[0], -motor.radius * turned[1], turned[1]], atol=1e-10)
    balance = instance.get("energy.kinetic") + instance.get("energy.dissipated") - instance.get("energy.input_work")
    assert abs(balance) < 1e-10
    instance.close()


def test_actuator_stays_where_the_start_tension_is_held(tmp_path):
    winch = detached(built(MAST))[1]["s2"]
    instance = opened(pack_native_fmu(winch, tmp_path / "winch.fmu"), tmp_path / "winch")
    before = instance.get("rest_length")
    instance.fmu.doStep(0.0, 1.0)
    assert instance.get("rest_length") == pytest.approx(before, abs=1e-13)
    instance.close()


def coupled(structure, actuator, h, count, current):
    """Heights of n2 with the two FMUs coupled through s2, both stepped in parallel."""
    rows = []
    for k in range(count):
        pull = structure.get("s2.force")
        actuator.set({"tension": pull, "current": current})
        structure.set({"s2.rest_length": actuator.get("rest_length"), "s2.rest_length_rate": actuator.get("rest_length_rate")})
        for one in (structure, actuator):
            one.fmu.doStep(k * h, h)
        rows.append(structure.get("n2.x", "n2.z"))
    return np.array(rows)


def test_coupled_fmus_converge_to_the_actuator_inside(tmp_path):
    model = built(MAST)
    bare, actuators = detached(model)
    structure, winch = pack_native_fmu(bare, tmp_path / "mast.fmu"), pack_native_fmu(actuators["s2"], tmp_path / "winch.fmu")
    current = 1.5 * float(model.current[0])
    errors = []
    for place, h in enumerate((4e-3, 2e-3, 1e-3)):
        pair = opened(structure, tmp_path / f"a{place}"), opened(winch, tmp_path / f"b{place}")
        found = coupled(*pair, h, round(0.4 / h), current)
        for one in pair:
            one.close()
        inside = simulate(model, held(model, grid(0.4, h), current=lambda t: [current]))
        errors.append(np.abs(found - inside.position[1:, 1][:, [0, 2]]).max())
    assert errors[2] < 1e-3 and errors[0] / errors[2] > 3.0, errors


def test_command_builds_structure_and_actuators(tmp_path, capsys):
    scene = tmp_path / "mast.toml"
    scene.write_text(TOML, encoding="utf-8")
    assert main([str(scene), "--detach-actuators", "--no-validate", "--output", str(tmp_path / "dist")]) == 0
    for runtime in PACKERS:
        structure = read_model_description(str(tmp_path / "dist" / runtime / "mast.fmu"))
        assert "s2.rest_length" in {v.name for v in structure.modelVariables if v.causality == "input"}
        assert (tmp_path / "dist" / runtime / "mast_s2_actuator.fmu").is_file()
    assert main(["two_bar", "--detach-actuators", "--no-validate", "--output", str(tmp_path / "none")]) == 2
    assert "two_bar has no actuator" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("version, naming", [("2.0", "structured"), ("1.0", "flat")])
def test_command_couples_structure_and_actuators(version, naming, tmp_path, capsys):
    """As fmpy reads the archive: the connections that are made by hand above, between the FMUs beside it."""
    scene = tmp_path / "mast.toml"
    scene.write_text(TOML, encoding="utf-8")
    options = ["--no-validate", "--no-page", "--naming", naming, "--output", str(tmp_path / "dist")]
    assert main([str(scene), "--detach-actuators", "--ssp", version, *options]) == 0
    dot = "." if naming == "structured" else "_"
    for runtime in PACKERS:
        path = tmp_path / "dist" / runtime / "mast.ssp"
        read = read_ssd(str(path), validate=version == "1.0")
        assert read.version == version
        ends = {(c.startElement, c.startConnector, c.endElement, c.endConnector) for c in read.system.connections}
        assert ends == {
            ("structure", f"s2{dot}force", "s2_actuator", "tension"),
            ("s2_actuator", "rest_length", "structure", f"s2{dot}rest_length"),
            ("s2_actuator", "rest_length_rate", "structure", f"s2{dot}rest_length_rate"),
        }
        assert {unit.name for unit in read.units} == {"m", "m/s", "N"}
        with zipfile.ZipFile(path) as file:
            packed = {element.name: file.read(element.source) for element in read.system.elements}
        for name, fmu in (("structure", "mast"), ("s2_actuator", "mast_s2_actuator")):
            assert packed[name] == (path.parent / f"{fmu}.fmu").read_bytes()
    for wrong, said in ((["--ssp", version], "give --detach-actuators"), (["--detach-actuators", "--ssp", "3"], "2.0 or 1.0")):
        assert main([str(scene), *wrong, *options[:-1], str(tmp_path / "none")]) == 2
        assert said in capsys.readouterr().err and not (tmp_path / "none").exists()


TOML = """
plane = "xz"
fixed = ["n1", "n3", "n4"]
nodes = { n1 = [0.0, 0.0], n2 = [0.0, 1.0], n3 = [-0.6, 0.0], n4 = [0.6, 0.0] }
bars = { b1 = { nodes = ["n1", "n2"], mass = 1.0 } }
prestress = { tension = { s2 = 25.0 } }
[materials]
cable = { stiffness = 2000.0, damping = 20.0 }
[actuators]
winch = { inertia = 2e-3, damping = 0.05, torque_constant = 0.4, radius = 0.05 }
[strings]
s1 = { nodes = ["n3", "n2"], material = "cable" }
s2 = { nodes = ["n4", "n2"], material = "cable", actuator = "winch" }
"""

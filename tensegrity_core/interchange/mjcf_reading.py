"""MuJoCo models of tensegrities (MJCF): bodies with capsules, sites, spatial tendons, as scenes.

MuJoCo itself reads the file, with all its defaults, frames and includes.  Here a body of one capsule or cylinder is a thin bar
with two point masses at its ends, so that mass, centre and moment of inertia across the bar are the body's; one of several is
as many bars, welded, among which its mass is divided by their lengths; one of none, which only slides, is a point mass.  A body
joins its parent, or the ground, by a ball joint, `connect` constraints are joints that do not give way, and bodies without
joints belong to their parents.  What hinges or slides in a plane makes a planar scene.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from .imported import Imported, Names, content, several

#: Places closer than this part of the model's extent are one node.
SAME = 1e-7
#: Of a body's mass: what of a point mass is left out, as round-off of a file or of a capsule's thickness.
ROUND_OFF = 1e-6
#: Of the moment of inertia about its own axis over that across: more than this makes a bar a thick one.
THICK = 0.01
MOST_BODIES = 20_000


def read(path: Path, unit: float | None) -> Imported:
    """The scene of a MuJoCo model; see `imported.import_scene`."""
    try:
        import mujoco
    except ModuleNotFoundError:
        raise InputError("MuJoCo models need mujoco, which is not installed: pip install mujoco") from None
    text = content(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{path} has a DOCTYPE, which no MuJoCo model needs; leave it out")
    with _quiet(mujoco):
        try:
            model = mujoco.MjModel.from_xml_path(str(path))
        except (ValueError, RuntimeError, mujoco.FatalError) as failure:
            told = " ".join(str(failure).split())[:300]
            raise InputError(f"{path} is no model that MuJoCo reads: {told}; correct it") from None
        if model.nbody > MOST_BODIES:
            problem = f"{path} has {model.nbody} bodies, more than {MOST_BODIES}"
            raise InputError(f"{problem}; leave out what the structure does not need")
        data = mujoco.MjData(model)
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_forward(model, data)
        if not np.isfinite(data.qacc).all():
            raise InputError(f"{path}: the model has no finite accelerations at its start; correct masses and stiffnesses")
        return _Reading(path, 1.0 if unit is None else unit, mujoco, model, data).made()


@contextmanager
def _quiet(mujoco: Any) -> Iterator[None]:
    """Warnings of MuJoCo go nowhere: left to itself, it writes them into a file in the present folder."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


class _Reading:
    """A scene as it grows.  unit: metres per length of 1; owner: node -> bodies (as MuJoCo counts them) that carry it; sited:
    nodes that are sites, whose names they have; held: node -> axes along which it does not move."""

    def __init__(self, path: Path, unit: float, mujoco: Any, model: Any, data: Any):
        self.path, self.unit, self.mj, self.model, self.data = path, unit, mujoco, model, data
        self.points: list[np.ndarray] = []
        self.names: list[str] = []
        self.owner: list[set[int]] = []
        self.sited: set[int] = set()
        self.held: dict[int, list[int]] = {}
        self.notes: list[str] = []
        self.grain = SAME * max(float(np.ptp(data.xpos, axis=0).max()), float(model.stat.extent), 1e-6)
        self.root = [int(weld) for weld in model.body_weldid]
        self.bars: list[tuple[str, int, int, float]] = []
        self.welds: list[list[int]] = []
        self.mass: dict[int, float] = {}

    def error(self, what: str, remedy: str) -> InputError:
        return InputError(f"{self.path}: {what}; {remedy}")

    def number(self, kind: str, name: str) -> int:
        """Of a kind of joint, geom, constraint, object or wrapping in MuJoCo's arrays."""
        return int(getattr(getattr(self.mj, kind), name))

    def name(self, kind: str, i: int) -> str:
        """Of a body, joint, site, geom or tendon; its number where it has none."""
        return getattr(self.model, kind)(i).name or f"{kind}{i}"

    def made(self) -> Imported:
        model, names = self.model, Names()
        self._require_joints()
        for site in range(model.nsite):
            self.sited.add(self._node(self.data.site_xpos[site], self.name("site", site), self.root[model.site_bodyid[site]]))
        for body in range(1, model.nbody):
            if self.root[body] == body:
                self._body(body)
        self._connect()
        strings = list(filter(None, map(self._string, range(model.ntendon))))
        used = sorted(
            {n for _, a, b, _ in self.bars for n in (a, b)} | {n for one in strings for n in one["path"]} | {*self.mass}
        )
        called = {n: names.take(self.names[n], "node") for n in used}
        bar_names = [names.take(name, "bar") for name, *_ in self.bars]
        axes = self._axes(used)
        letters = ["xyz"[axis] for axis in axes]
        tables: dict[str, Any] = {"name": Names().take(self._title(), "scene"), "start": "released"}
        tables["description"] = f"Imported from the MuJoCo model {self.path.name}"
        gravity = (self.unit * model.opt.gravity).tolist()
        tables["gravity"] = gravity
        tables |= {"plane": "".join(letters)} if len(axes) == 2 else {}
        tables["fixed"] = [called[n] for n in used if 0 in self.owner[n]]
        tables["fixed"] += [f"{called[n]}.{'xyz'[axis]}" for n, held in sorted(self.held.items()) for axis in held]
        tables["nodes"] = {called[n]: (self.unit * self.points[n])[axes].tolist() for n in used}
        tables["bars"] = {
            name: {"nodes": [called[a], called[b]], "mass": mass} for name, (_, a, b, mass) in zip(bar_names, self.bars)
        }
        tables["weld"] = [[bar_names[bar] for bar in weld] for weld in self.welds]
        tables |= self._string_tables(strings, called, names)
        tables["point_masses"] = {called[n]: mass for n, mass in sorted(self.mass.items()) if 0 not in self.owner[n]}
        tables["velocities"] = self._velocities(used, called, axes)
        self._note_rest()
        notes = (*self.notes, *several(names.renamed))
        return Imported(self.path, {key: one for key, one in tables.items() if one not in ({}, [])}, notes)

    def _title(self) -> str:
        named = bytes(self.model.names).split(b"\0")[0].decode("utf-8", "replace")
        return named if named not in ("", "MuJoCo Model") else self.path.stem

    # --- nodes --------------------------------------------------------------------------------------------------------

    def _node(self, at: np.ndarray, name: str, body: int) -> int:
        """The node at a place that a body carries; a new one where none is."""
        for n, point in enumerate(self.points):
            if np.abs(point - at).max() <= self.grain and (body in self.owner[n] or not self.owner[n]):
                self.owner[n].add(body)
                return n
        self.points.append(np.array(at))
        self.names.append(name)
        self.owner.append({body})
        return len(self.points) - 1

    def _join(self, at: np.ndarray, first: int, second: int, name: str) -> None:
        """One node in place of those of two bodies at a place."""
        one, other = self._node(at, name, first), self._node(at, name, second)
        if one == other:
            return
        self.owner[one] |= self.owner[other]
        self.owner[other] = set()
        self.points[other] = np.full(3, np.nan)  # nowhere
        if other in self.sited:
            self.names[one] = self.names[other]
            self.sited.add(one)
        new = {other: one}
        self.bars = [(bar, new.get(a, a), new.get(b, b), mass) for bar, a, b, mass in self.bars]
        if other in self.mass:
            self.mass[one] = self.mass.get(one, 0.0) + self.mass.pop(other)

    # --- bodies -------------------------------------------------------------------------------------------------------

    def _require_joints(self) -> None:
        """A planar scene where all joints are hinges across a plane and slides in it."""
        model = self.model
        hinges = [j for j in range(model.njnt) if model.jnt_type[j] == self.number("mjtJoint", "mjJNT_HINGE")]
        self.normal = -1
        for j in hinges:
            axis = np.abs(self.data.xaxis[j])
            along = int(np.argmax(axis))
            if axis[along] < 1.0 - 1e-9 or self.normal not in (-1, along):
                what = f"the hinge {self.name('joint', j)} is neither a ball joint nor across the plane of the others"
                raise self.error(what, "use ball joints, or hinges with one axis along x, y or z")
            self.normal = along
        if hinges and any(
            model.jnt_type[j] in (self.number("mjtJoint", "mjJNT_FREE"), self.number("mjtJoint", "mjJNT_BALL"))
            for j in range(model.njnt)
        ):
            raise self.error("it has hinges and free or ball joints", "use one kind: a planar scene or one in space")
        if any(abs(model.jnt_stiffness[j]) > 0 or model.dof_damping[model.jnt_dofadr[j]] > 0 for j in range(model.njnt)):
            raise self.error("joints have stiffness or damping, which no joint has here", "set them to 0")

    def _body(self, body: int) -> None:
        """A rigid body with all that is welded to it."""
        model = self.model
        parts = [i for i in range(1, model.nbody) if self.root[i] == body]
        shapes = [g for g in range(model.ngeom) if model.geom_bodyid[g] in parts and self._is_long(g)]
        self._joints_of(body, bool(shapes))
        if not shapes:
            self._point(body, parts)
            return
        first = len(self.bars)
        for g in shapes:
            half = self.model.geom_size[g][1] * self.data.geom_xmat[g].reshape(3, 3)[:, 2]
            at = self.data.geom_xpos[g]
            a, b = (self._node(at + sign * half, f"{self.name('geom', g)}_{end}", body) for sign, end in ((-1, "a"), (1, "b")))
            if a == b:
                what = f"the geom {self.name('geom', g)} is so short that its ends are one node in a model of this extent"
                raise self.error(what, "give it another length, or leave out what lies far off")
            self.bars.append((self.name("geom", g), a, b, 0.0))
        self._weigh(body, parts, first)
        if len(shapes) > 1:
            self.welds.append(list(range(first, len(self.bars))))

    def _is_long(self, g: int) -> bool:
        return self.model.geom_type[g] in (self.number("mjtGeom", "mjGEOM_CAPSULE"), self.number("mjtGeom", "mjGEOM_CYLINDER"))

    def _joints_of(self, body: int, bars: bool) -> None:
        """Ball joints and hinges make nodes that the body shares with its parent, or that slide along some axes; a body that
        floats has none."""
        model = self.model
        own = (
            range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]) if model.body_jntnum[body] else ()
        )
        types = [model.jnt_type[j] for j in own]
        rails = [j for j, kind in zip(own, types) if kind == self.number("mjtJoint", "mjJNT_SLIDE")]
        turning = [j for j, kind in zip(own, types) if kind in (self.number("mjtJoint", "mjJNT_BALL"), self._hinge())]
        space = 2 if self.normal >= 0 else 3
        if self.number("mjtJoint", "mjJNT_FREE") in types or len(rails) == space:
            return
        parent = self.root[model.body_parentid[body]]
        if len(turning) > 1 or (rails and parent) or not (turning or (rails and not bars)):
            what = f"the body {self.name('body', body)} neither floats nor turns about one point"
            raise self.error(what, "give it a free joint, a ball joint, or slides along all axes")
        if not rails:
            self._join(self.data.xanchor[turning[0]], parent, body, f"{self.name('body', body)}_joint")
            return
        name = f"{self.name('body', body)}_rail"
        node = self._node(self.data.xanchor[turning[0]] if turning else self.data.xpos[body], name, body)
        self.held[node] = self._held(rails)

    def _hinge(self) -> int:
        return self.number("mjtJoint", "mjJNT_HINGE")

    def _held(self, rails: list[int]) -> list[int]:
        """Axes along which slides do not lead."""
        led = set()
        for j in rails:
            axis = np.abs(self.data.xaxis[j])
            if axis.max() < 1.0 - 1e-9:
                raise self.error(f"the slide {self.name('joint', j)} is along no axis", "let it slide along x, y or z")
            led.add(int(np.argmax(axis)))
        return [axis for axis in range(3) if axis not in (*led, self.normal)]

    def _inertia(self, parts: list[int]) -> tuple[float, np.ndarray, np.ndarray]:
        """Mass, centre, and inertia about it, of bodies that are one."""
        mass = self.model.body_mass[parts]
        centre = np.average(self.data.xipos[parts], axis=0, weights=mass) if mass.sum() > 0 else self.data.xipos[parts[0]]
        found = np.zeros((3, 3))
        for i, m in zip(parts, mass):
            turn, away = self.data.ximat[i].reshape(3, 3), self.data.xipos[i] - centre
            found += turn @ np.diag(self.model.body_inertia[i]) @ turn.T + m * (away @ away * np.eye(3) - np.outer(away, away))
        return float(mass.sum()), centre, found

    def _weigh(self, body: int, parts: list[int], first: int) -> None:
        """Mass of a body's bars; of one bar with what stands at its ends."""
        mass, centre, inertia = self._inertia(parts)
        name = self.name("body", body)
        if len(self.bars) - first > 1:
            lengths = [float(np.linalg.norm(self.points[b] - self.points[a])) for _, a, b, _ in self.bars[first:]]
            for i, length in enumerate(lengths, first):
                self.bars[i] = (*self.bars[i][:3], mass * length / sum(lengths))
            self.notes.append(f"The mass of {name} is divided among its bars by their lengths: centre and inertia may differ.")
            return
        bar, a, b, _ = self.bars[first]
        along = self.points[b] - self.points[a]
        length = float(np.linalg.norm(along))
        unit = along / length
        axial, across = unit @ inertia @ unit, 0.5 * (np.trace(inertia) - unit @ inertia @ unit)
        at = float((centre - self.points[a]) @ unit)
        off = float(np.linalg.norm(centre - self.points[a] - at * unit))
        moment, square = mass * at / length, (across + mass * at**2) / length**2
        own = 6.0 * (moment - square)
        end = moment - 0.5 * own
        weights = [own, mass - own - end, end]
        if min(weights) < -1e-3 * mass or off > 1e-3 * length:
            what = f"the body {name} has its mass elsewhere than along its capsule, as no bar with masses at its ends has"
            raise self.error(what, "correct its inertial, or leave that to its geoms")
        if across > 0.0 and axial > THICK * across:
            self.notes.append(f"{name} does not turn about its own axis here: it is taken for thin.")
        self.bars[first] = (bar, a, b, max(own, 0.0))
        for node, value in zip((a, b), weights[1:]):
            if value > ROUND_OFF * mass:
                self.mass[node] = self.mass.get(node, 0.0) + value

    def _point(self, body: int, parts: list[int]) -> None:
        mass, centre, _ = self._inertia(parts)
        slides = self.model.jnt_type[self.model.body_jntadr[body]] == self.number("mjtJoint", "mjJNT_SLIDE")
        if not slides:
            self.notes.append(f"{self.name('body', body)} has no capsule and is a point mass at its centre: it does not turn.")
        node = self._node(centre, self.name("body", body), body)
        away = [n for n, owners in enumerate(self.owner) if owners == {body} and n != node]
        if away and not slides:
            what = f"the body {self.name('body', body)} has no capsule, and sites away from its centre"
            raise self.error(what, "give it capsules between its sites, or slides in place of a free joint")
        self.mass[node] = self.mass.get(node, 0.0) + mass

    def _connect(self) -> None:
        model = self.model
        for e in range(model.neq):
            if not model.eq_active0[e]:
                continue
            if model.eq_type[e] != self.number("mjtEq", "mjEQ_CONNECT") or model.eq_objtype[e] != self.number(
                "mjtObj", "mjOBJ_BODY"
            ):
                raise self.error(f"the equality constraint {e} is no `connect` of two bodies", "leave it out")
            one, other = (int(i) for i in (model.eq_obj1id[e], model.eq_obj2id[e]))
            at = self.data.xpos[one] + self.data.xmat[one].reshape(3, 3) @ model.eq_data[e][:3]
            there = self.data.xpos[other] + self.data.xmat[other].reshape(3, 3) @ model.eq_data[e][3:6]
            if np.abs(at - there).max() > 100.0 * self.grain:
                raise self.error(f"the `connect` {e} joins places that are apart at the start", "let them meet there")
            self._join(at, self.root[one], self.root[other], f"joint{e}")
        if model.neq:
            self.notes.append("`connect` constraints are soft there; here no joint gives way.")

    # --- strings ------------------------------------------------------------------------------------------------------

    def _string(self, t: int) -> dict[str, Any] | None:
        model, name = self.model, self.name("tendon", t)
        first, count = model.tendon_adr[t], model.tendon_num[t]
        if any(model.wrap_type[w] != self.number("mjtWrap", "mjWRAP_SITE") for w in range(first, first + count)):
            raise self.error(f"the tendon {name} runs over geoms, pulleys or joints", "let it run over sites alone")
        stiffness = float(np.ravel(model.tendon_stiffness[t])[0])
        low, high = model.tendon_lengthspring[t].tolist()
        if low not in (0.0, high):
            raise self.error(
                f"the tendon {name} has a spring between {low:g} and {high:g}", "write springlength as 0 and a length, or one"
            )
        if stiffness <= 0.0:
            self.notes.append(f"The tendon {name} has no stiffness and is left out.")
            return None
        sites = [int(model.wrap_objid[w]) for w in range(first, first + count)]
        path = [self._node(self.data.site_xpos[s], self.name("site", s), self.root[model.site_bodyid[s]]) for s in sites]
        damping = float(np.ravel(model.tendon_damping[t])[0])
        return {
            "name": name,
            "path": path,
            "stiffness": stiffness,
            "damping": damping,
            "rest": high,
            "two_way": low == high > 0.0,
        }

    def _string_tables(self, strings: list[dict], called: dict[int, str], names: Names) -> dict[str, Any]:
        tables, rest = {}, {}
        for one in strings:
            name = names.take(one["name"], "string")
            tables[name] = {"nodes": [called[n] for n in one["path"]], "stiffness": one["stiffness"], "damping": one["damping"]}
            tables[name] |= {"two_way": True} if one["two_way"] else {}
            rest[name] = self.unit * one["rest"]
        if any(one["damping"] for one in strings):
            self.notes.append("Dampers of tendons act while these are slack, too; here they are idle then.")
        return {"strings": tables, "prestress": {"rest_length": rest}} if tables else {}

    # --- the rest -----------------------------------------------------------------------------------------------------

    def _axes(self, used: list[int]) -> list[int]:
        """Axes of the scene; in a plane all nodes have one coordinate across it."""
        if self.normal < 0:
            return [0, 1, 2]
        across = np.array([self.points[n][self.normal] for n in used])
        if len(across) and float(np.ptp(across)) > self.grain:
            raise self.error("its hinges are those of a plane, and its sites are not in one", "put them into one plane")
        return [axis for axis in range(3) if axis != self.normal]

    def _velocities(self, used: list[int], called: dict[int, str], axes: list[int]) -> dict[str, list[float]]:
        found, speed = {}, np.zeros(6)
        for n in used:
            body = next((body for body in self.owner[n] if body), 0)
            if not body or 0 in self.owner[n]:
                continue
            self.mj.mj_objectVelocity(self.model, self.data, self.number("mjtObj", "mjOBJ_XBODY"), body, speed, 0)
            v = self.unit * (speed[3:] + np.cross(speed[:3], self.points[n] - self.data.xpos[body]))
            if v.any():
                found[called[n]] = v[axes].tolist()
        return found

    def _note_rest(self) -> None:
        model = self.model
        what = {"actuators": model.nu, "limits of tendons": int(np.sum(model.tendon_limited)), "planes": self._planes()}
        what["friction in tendons"] = int(np.count_nonzero(model.tendon_frictionloss))
        what["armatures"] = int(np.count_nonzero(model.dof_armature)) + int(np.count_nonzero(model.tendon_armature))
        what["limits of joints"] = int(np.sum(model.jnt_limited))
        what["air"] = int(model.opt.density > 0 or model.opt.viscosity > 0)
        left = [name for name, count in what.items() if count]
        if left:
            self.notes.append(f"Left out: {', '.join(left)}.")
        if self.unit != 1.0:
            self.notes.append(f"Lengths of 1 were read as {self.unit:g} m; masses and stiffnesses are as they stand there.")

    def _planes(self) -> int:
        return int(np.sum(self.model.geom_type == self.number("mjtGeom", "mjGEOM_PLANE")))

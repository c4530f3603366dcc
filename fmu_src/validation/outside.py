"""Runs an FMU as a stranger would: `python -I outside.py job.json result.npz`, with numpy and fmpy and nothing else.

The job: {"fmu": path, "runs": [{"name", "arrays": .npz path, "inputs": [names], "parameters": {name: value}, "host": words for
outside3.py}]}; an array file holds times (K+1,) in s and values (K, number of inputs; of arrays, elements).
The result holds for each run `name/outputs` (K+1, number of outputs; row 0 in Initialization Mode), `name/events` (number, 4:
time, string, before, after) and `name/seconds`, and `output_names`, `strings`.  The project's own packages are barred: what
runs is what the FMU holds.
A third argument, WITH_PARENT, ends the run when standard input ends.
"""

import ctypes
import importlib.abc
import importlib.util
import json
import os
import re
import sys
import threading
import time
from typing import Any

import numpy as np

BARRED = ("tensegrity_core", "fmu_src", "pythonfmu", "scipy")
CATEGORIES = ("logEvents", "logStatusDiscard", "logStatusError")
EVENT = re.compile(r"(?:string|contact) (\S+):(?: piece)? (-?\d+) -> (-?\d+) at t = (\S+) s")


#: See above.
WITH_PARENT = "with-parent"


class Barrier(importlib.abc.MetaPathFinder):
    """Refuses to import packages that an importing tool does not have."""

    def find_spec(self, fullname, path=None, target=None):
        if fullname.split(".")[0] in BARRED:
            raise ModuleNotFoundError(f"{fullname} must not be needed by the FMU")
        return None


class Instance:
    """An FMU of co-simulation in one process, through fmpy's low-level calls with arrays made once.

    messages: (status, category, text) that the FMU logged.
    """

    #: fmpy's access to a library of this kind, and where its description has that.
    ACCESS, KIND = "FMU2Slave", "coSimulation"
    #: What calls for values are named by.
    VALUES = ("fmi2{}Real", "fmi2{}Integer")

    def __init__(self, description, folder, name="outside", logging=False, categories=()):
        self.description, self.messages = description, []
        self.by_name = {variable.name: variable for variable in description.modelVariables}
        self.fmu = self._access()(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=getattr(description, self.KIND).modelIdentifier,
            instanceName=name,
        )
        self._instantiate(logging)
        if categories:
            self.fmu.setDebugLogging(True, list(categories))

    def _access(self):
        from fmpy import fmi2

        self.fmi2 = fmi2
        return getattr(fmi2, self.ACCESS)

    def _instantiate(self, logging):
        callbacks = self.fmi2.fmi2CallbackFunctions()
        callbacks.logger = self.fmi2.fmi2CallbackLoggerTYPE(self._log)
        callbacks.allocateMemory = self.fmi2.defaultCallbacks.allocateMemory
        callbacks.freeMemory = self.fmi2.defaultCallbacks.freeMemory
        self._callbacks = callbacks
        self.fmu.instantiate(callbacks=callbacks, loggingOn=logging)

    def _log(self, environment, name, status, category, message):
        self.messages.append((status, (category or b"").decode(), message.decode()))

    def references(self, names):
        """Array of value references."""
        return (ctypes.c_uint * len(names))(*(self.by_name[name].valueReference for name in names))

    def elements(self, name):
        """Names of a variable's values: of an array those of its elements."""
        return [name]

    def call(self, way, integers):
        """FMI's function that gets or sets values: references, count, values, how many.  way: "Get" or "Set"."""
        function, component = getattr(self.fmu, self.VALUES[integers].format(way)), self.fmu.component
        return lambda references, count, values, size: function(component, references, count, values)

    def start(self, parameters=None, start_time=0.0, **setup):
        """Set start values by name and go through Initialization Mode up to the first step."""
        self.fmu.setupExperiment(startTime=start_time, **setup)
        self.set(parameters or {})
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def begin(self):
        """Called between initialization and the first step."""

    def give(self, ports, changed):
        """Set inputs before a step; changed: whether some have."""
        ports.set()

    def step(self, time, h, resume=None):
        """resume(t): sets the inputs anew where a step has ended early, at t."""
        self.fmu.fmi2DoStep(self.fmu.component, time, h, True)

    def set(self, values):
        for name, value in values.items():
            variable = self.by_name[name]
            setter = self.fmu.setReal if variable.type == "Real" else self.fmu.setInteger
            setter([variable.valueReference], [value])

    def get(self, *names):
        found = []
        for name in names:
            variable = self.by_name[name]
            getter = self.fmu.getReal if variable.type == "Real" else self.fmu.getInteger
            found += getter([variable.valueReference])
        return found[0] if len(names) == 1 else found

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()


class Block:
    """Values of some variables, of one type, that are set or read in one call; `view` shows them."""

    def __init__(self, instance, names, integers=False):
        self.names = [element for name in names for element in instance.elements(name)]
        type_: Any = ctypes.c_int32 if integers else ctypes.c_double
        values = (type_ * len(self.names))()
        self._arguments = instance.references(names), len(names), values, len(values)
        self._set, self._get = instance.call("Set", integers), instance.call("Get", integers)
        self.view = np.frombuffer(values, dtype=type_) if len(values) else np.zeros(0)

    def set(self):
        """Send what `view` shows."""
        if self.names:
            self._set(*self._arguments)

    def get(self):
        """Ask for all; `view` shows them."""
        if self.names:
            self._get(*self._arguments)


class Inputs:
    """Held inputs at any time.  An input whose time derivative is an input, too, moves with it during a step."""

    def __init__(self, instance, names, times, values):
        self.block, self.times, self.values, self.k = Block(instance, names), times, values, 0
        place, rates = {element: i for i, element in enumerate(self.block.names)}, {}  # type: ignore[var-annotated]
        for name in names:
            whole = instance.by_name[name].derivative
            if whole is not None and whole.name in names:
                pairs = zip(instance.elements(whole.name), instance.elements(name))
                rates |= {place[element]: place[rate] for element, rate in pairs}
        self.order = [(i, rates[i], rates.get(rates[i])) for i in rates if rates[i] in rates]
        self.order += [(i, rates[i], None) for i in rates if rates[i] not in rates]

    def at(self, t, k):
        """(n,) at t of step k."""
        now, tau = self.values[k].copy(), t - self.times[k]
        for i, first, second in self.order:
            now[i] += now[first] * tau + (0.5 * self.values[k, second] * tau * tau if second is not None else 0.0)
        return now

    def apply(self, t, **_):
        """Called by fmpy's solver, too."""
        self.block.view[:] = self.at(t, self.k)
        self.block.set()

    def jump(self, k):
        """Whether step k does not go on with what the one before it ended with."""
        return not np.array_equal(self.at(self.times[k], k - 1), self.values[k])


class Ports:
    """All inputs and all outputs of an instance; set, step and get are one communication step."""

    def __init__(self, instance, inputs):
        self.instance = instance
        outputs = [v for v in instance.description.modelVariables if v.causality == "output"]
        whole = ("Integer", "Enumeration", "Int32")
        self.given = Block(instance, inputs)
        self._reals = Block(instance, [v.name for v in outputs if v.type in ("Real", "Float64")])
        self._integers = Block(instance, [v.name for v in outputs if v.type in whole], integers=True)
        self.names, self.inputs = self._reals.names + self._integers.names, self.given.view
        self.set = self.given.set

    def get(self):
        """Ask for all outputs; `row` shows them."""
        self._reals.get()
        self._integers.get()

    def step(self, time, h):
        self.instance.step(time, h)

    def row(self):
        return np.concatenate((self._reals.view, self._integers.view))


def run(instance, times, values, inputs, parameters, told=None):
    """Simulate held inputs.  Returns outputs (K+1, n), their names, and the seconds of the stepping loop.

    told: gets the part of the steps that is done, 0 to 1.
    """
    fmu = instance.fmu
    fmu.setupExperiment(startTime=times[0])
    instance.set(parameters)
    ports, held = Ports(instance, inputs), Inputs(instance, inputs, times, values)
    ports.inputs[:] = values[0]
    ports.set()
    fmu.enterInitializationMode()
    ports.get()
    out = np.empty((len(times), len(ports.names)))
    out[0] = ports.row()
    fmu.exitInitializationMode()
    instance.begin()
    begin = time.perf_counter()
    for k, now in enumerate(times[:-1]):
        ports.inputs[:] = values[k]
        instance.give(ports, k and np.any(values[k] != values[k - 1]))
        held.k = k
        instance.step(now, times[k + 1] - now, held.apply)
        ports.get()
        out[k + 1] = ports.row()
        if told:
            told((k + 1) / len(values))
    return out, ports.names, time.perf_counter() - begin


def events(messages, strings):
    """Transitions from the messages of category logEvents; `strings` collects names, of
    strings and of nodes that touch the ground, in order of appearance."""
    rows = []
    for _, category, text in messages:
        found = EVENT.search(text) if category == "logEvents" else None
        if found:
            name, before, after, at = found.groups()
            if name not in strings:
                strings.append(name)
            rows.append((float(at), strings.index(name), int(before), int(after)))
    return np.array(rows).reshape(-1, 4)


def end_with_parent():
    """Ends this process, busy or not, when standard input ends, as it does with the process that holds its other end."""

    def watch():
        while os.read(0, 1):
            pass
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def beside(name):
    """A module that lies beside this script, which `python -I` does not look around for."""
    found = importlib.util.spec_from_file_location(name, os.path.join(os.path.dirname(__file__), f"{name}.py"))
    module = importlib.util.module_from_spec(found)  # type: ignore[arg-type]
    found.loader.exec_module(module)  # type: ignore[union-attr]
    return module


def main(job_path, result_path, *options, make=Instance, run=run):
    """make, run: what runs an FMU of another kind, see exchange.py."""
    if WITH_PARENT in options:
        end_with_parent()
    sys.meta_path.insert(0, Barrier())
    from fmpy import extract, read_model_description

    with open(job_path, encoding="utf-8") as file:
        job = json.load(file)
    os.chdir(os.path.abspath(os.sep))  # lxml wants a current folder whose name is UTF-8; all paths here are absolute
    description = read_model_description(job["fmu"])
    folder = extract(job["fmu"], unzipdir=os.path.join(os.path.dirname(result_path), "fmu"))
    fmi3 = None if description.fmiVersion == "2.0" else beside("outside3")
    result, strings = {}, []  # type: ignore[var-annotated]
    for item in job["runs"]:
        arrays = np.load(item["arrays"])
        made = fmi3.instances(make.KIND, item.get("host", ())) if fmi3 else make
        instance = made(description, folder, item["name"], True, CATEGORIES)
        out, names, seconds = run(instance, arrays["times"], arrays["values"], item["inputs"], item["parameters"])
        instance.close()
        result[f"{item['name']}/outputs"] = out
        result[f"{item['name']}/events"] = events(instance.messages, strings)
        result[f"{item['name']}/seconds"] = seconds
        result["output_names"] = names
    loaded = [name for name in sys.modules if name.split(".")[0] in BARRED]
    if loaded:
        raise SystemExit(f"the FMU loaded {loaded} from outside")
    np.savez(result_path, strings=np.array(strings, dtype=str), **result)


if __name__ == "__main__":
    main(*sys.argv[1:])

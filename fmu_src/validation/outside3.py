"""Runs FMUs of FMI 3.0 by the scripts outside.py and exchange.py, which lie beside it: fmpy's access under FMI 2.0's names.

Options: `events`: Event Mode is used, and takes the inputs that change; `early`: steps end at transitions, to go on from
there.
"""

import ctypes
import importlib.util
import os
from xml.etree import ElementTree

from fmpy.fmi3 import FMU3Model, FMU3Slave

if __package__:
    from . import outside
else:  # a script of its own, see outside.beside
    found = importlib.util.spec_from_file_location("outside", os.path.join(os.path.dirname(__file__), "outside.py"))
    outside = importlib.util.module_from_spec(found)  # type: ignore[arg-type]
    found.loader.exec_module(outside)  # type: ignore[union-attr]


class _Renamed:
    """Calls that have another name in FMI 2.0, or come at another time."""

    def setupExperiment(self, **setup):
        self.setup = setup

    def enterInitializationMode(self):
        super().enterInitializationMode(**self.setup)  # type: ignore[misc]

    def newDiscreteStates(self):
        return self.updateDiscreteStates()  # type: ignore[attr-defined]


class _Slave(_Renamed, FMU3Slave):
    pass


class _Model(_Renamed, FMU3Model):
    def getDerivatives(self, derivatives, count):
        return self.getContinuousStateDerivatives(derivatives, count)


class Instance(outside.Instance):
    """An FMU of co-simulation."""

    VALUES = ("fmi3{}Float64", "fmi3{}Int32")
    events = early = False

    def _access(self):
        return _Model if self.KIND == "modelExchange" else _Slave

    def _instantiate(self, logging):
        def told(environment, status, category, message):
            self._log(environment, None, status, category, message)

        self.fmu.instantiate(loggingOn=logging, logMessage=told, **self._chosen())

    def _chosen(self):
        return {"eventModeUsed": self.events, "earlyReturnAllowed": self.early}

    def elements(self, name):
        shape = self.by_name[name].shape
        return [f"{name}[{i + 1}]" for i in range(shape[0])] if shape else [name]

    def call(self, way, integers):
        function, component = getattr(self.fmu, self.VALUES[integers].format(way)), self.fmu.component
        return lambda references, count, values, size: function(component, references, count, values, size)

    def set(self, values):
        for name, value in values.items():
            variable = self.by_name[name]
            kind = "Int64" if variable.type == "Enumeration" else variable.type
            getattr(self.fmu, f"set{kind}")([variable.valueReference], value if isinstance(value, list) else [value])

    def get(self, *names):
        found = []
        for name in names:
            variable = self.by_name[name]
            kind = "Int64" if variable.type == "Enumeration" else variable.type
            values = getattr(self.fmu, f"get{kind}")([variable.valueReference], len(self.elements(name)))
            found.append(values if variable.shape else values[0])
        return found[0] if len(names) == 1 else found

    def begin(self):
        if self.events:
            self.settle()

    def give(self, ports, changed):
        if self.events and changed:
            self.fmu.enterEventMode()
        ports.set()
        if self.events and changed:
            self.settle()

    def step(self, time, h, resume=None):
        end = time + h
        _, _, early, now = self.fmu.doStep(time, h)
        while early:
            if self.events:
                self.fmu.enterEventMode()
            resume(now)
            if self.events:
                self.settle()
            _, _, early, now = self.fmu.doStep(now, end - now)

    def settle(self):
        """Out of Event Mode."""
        while self.fmu.updateDiscreteStates()[0]:
            pass
        self.fmu.enterStepMode()


class Model(Instance):
    """An FMU of model exchange."""

    KIND = "modelExchange"

    def _chosen(self):
        return {}

    def partials(self):
        """See exchange.Instance; fmpy 0.3.32 does not know whether an FMU of FMI 3.0 has them."""
        root = ElementTree.parse(os.path.join(self.fmu.unzipDirectory, "modelDescription.xml")).getroot()
        if root.find("ModelExchange[@providesDirectionalDerivatives='true']") is None:
            return None
        listed = [unknown.variable for unknown in self.description.derivatives]
        rates = (ctypes.c_uint * len(listed))(*(rate.valueReference for rate in listed))
        states, seeds = [], []
        for state in (rate.derivative for rate in listed):
            size = state.shape[0] if state.shape else 1
            states += [ctypes.c_uint(state.valueReference)] * size
            seeds += [(ctypes.c_double * size)(*(float(i == j) for j in range(size))) for i in range(size)]
        call, component, count = self.fmu.fmi3GetDirectionalDerivative, self.fmu.component, len(states)

        def filled(i, column):
            call(component, rates, len(rates), states[i], 1, seeds[i], len(seeds[i]), column, count)

        return filled


def instances(kind, host=()):
    """What makes instances of a kind, see Instance.KIND, for a host with these options."""
    base = Model if kind == "modelExchange" else Instance
    return type("Chosen", (base,), dict.fromkeys(host, True))

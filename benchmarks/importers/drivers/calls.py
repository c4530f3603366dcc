"""fmpy's low-level calls, in the order in which a careful host makes them."""

import shutil

from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave


def rows(path, job):
    """Outputs at all communication points of a job, of the FMU in this file."""
    description, folder = read_model_description(path), extract(path)
    references = {variable.name: variable.valueReference for variable in description.modelVariables}
    three = description.fmiVersion.startswith("3")
    fmu = (FMU3Slave if three else FMU2Slave)(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )
    outputs = [references[name] for name in job.whole_outputs()]

    def send(values):
        whole = job.whole(values)
        flat = [x for value in whole.values() for x in (value if isinstance(value, list) else [value])]
        (fmu.setFloat64 if three else fmu.setReal)([references[name] for name in whole], flat)

    def read():
        return fmu.getFloat64(outputs, len(job.outputs)) if three else fmu.getReal(outputs)

    span = {"startTime": 0.0, "stopTime": job.steps * job.step}
    fmu.instantiate()
    if not three:
        fmu.setupExperiment(**span)
    fmu.enterInitializationMode(**(span if three else {}))
    send(job.inputs(0))
    found = [read()]
    fmu.exitInitializationMode()
    for k in range(job.steps):
        send(job.inputs(k))
        fmu.doStep(currentCommunicationPoint=k * job.step, communicationStepSize=job.step)
        found.append(read())
    fmu.terminate()
    fmu.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)
    return found

"""fmpy's low-level calls, in the order in which a careful host makes them."""

import shutil

from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from job import finish, job

job = job()
description, folder = read_model_description(job.fmu), extract(job.fmu)
fmu = FMU2Slave(
    guid=description.guid, unzipDirectory=folder, modelIdentifier=description.coSimulation.modelIdentifier, instanceName="one"
)
outputs = [job.references[name] for name in job.outputs]


def send(values):
    fmu.setReal([job.references[name] for name in values], list(values.values()))


fmu.instantiate()
fmu.setupExperiment(startTime=0.0, stopTime=job.steps * job.step)
fmu.enterInitializationMode()
send(job.inputs(0))
rows = [fmu.getReal(outputs)]
fmu.exitInitializationMode()
for k in range(job.steps):
    send(job.inputs(k))
    fmu.doStep(currentCommunicationPoint=k * job.step, communicationStepSize=job.step)
    rows.append(fmu.getReal(outputs))
fmu.terminate()
fmu.freeInstance()
shutil.rmtree(folder, ignore_errors=True)
finish(rows)

"""Co-simulation: the kernel integrates, by fmpy's low-level calls.  Settings: its tolerance."""

from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from job import JOB, carry_out

description, folder = read_model_description(JOB.fmu), extract(JOB.fmu)
outputs, forces = [JOB.references[name] for name in JOB.outputs], [JOB.references[name] for name in JOB.forces]


def prepared(tolerance):
    fmu = FMU2Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )
    fmu.instantiate()
    fmu.setupExperiment(startTime=0.0)
    fmu.setReal([JOB.references["solver.tolerance"]], [tolerance])
    fmu.setReal(forces, list(JOB.forces.values()))
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()

    def run():
        rows = []
        for k in range(JOB.instants):
            fmu.doStep(JOB.duration * k / JOB.instants, JOB.interval)
            rows.append(fmu.getReal(outputs))
        fmu.terminate()
        fmu.freeInstance()
        return rows

    return run


carry_out(prepared)

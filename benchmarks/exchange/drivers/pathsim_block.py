"""PathSim's ModelExchangeFMU block with an explicit method of order 8.  Settings: tolerance."""

import pathsim.solvers
from job import JOB, carry_out
from pathsim import Connection, Simulation
from pathsim.blocks import Constant
from pathsim_fmi import ModelExchangeFMU


class Block(ModelExchangeFMU):
    """PathSim asks a block whether inputs reach its outputs at once by varying them about zero: no rest length is negative."""

    def __len__(self):
        return 1


def prepared(tolerance, method=pathsim.solvers.RKDP87):
    block = Block(JOB.fmu, instance_name="one", start_values=dict(JOB.forces), tolerance=1e-12)
    described = block.fmu_wrapper.model_description.modelVariables
    names = [variable.name for variable in described if variable.causality == "output"]
    starts = [JOB.forces.get(one.name, float(one.start)) for one in described if one.causality == "input"]
    sources = [Constant(start) for start in starts]  # an input without one is set to zero
    wires = [Connection(source[0], block[i]) for i, source in enumerate(sources)]
    chosen = [names.index(name) for name in JOB.outputs]
    accuracy = {"tolerance_lte_abs": tolerance, "tolerance_lte_rel": tolerance}
    simulation = Simulation([*sources, block], wires, dt=1e-4, Solver=method, log=False, **accuracy)

    def row():
        return [float(block.outputs.to_array()[i]) for i in chosen]

    def run():
        rows = []
        for _ in range(JOB.instants):
            simulation.run(JOB.interval, reset=False, adaptive=True)
            rows.append(row())
        return rows

    return run


carry_out(prepared)

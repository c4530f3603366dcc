"""fmpy's simulate_fmu with its Euler steps.  Settings: the step, s."""

from fmpy import extract, read_model_description, simulate_fmu
from job import JOB, carry_out

description, folder = read_model_description(JOB.fmu), extract(JOB.fmu)


def prepared(step):
    def run():
        found = simulate_fmu(
            folder,
            model_description=description,
            fmi_type="ModelExchange",
            solver="Euler",
            step_size=step,
            stop_time=JOB.duration,
            output_interval=step,
            record_events=False,
            start_values=JOB.forces,
            output=JOB.outputs,
        )
        return [list(row)[1:] for row in found[:: round(JOB.interval / step)][1:]]

    return run


carry_out(prepared)

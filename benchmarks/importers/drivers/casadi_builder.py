"""CasADi's DaeBuilder: the derivatives of the states as a function of CasADi's.  It asks for no event indicators, so that its
integrators cannot follow strings that go slack: no trajectory is compared."""

import zipfile

import casadi
from job import finish, job

job = job()
with zipfile.ZipFile(job.fmu) as archive:
    archive.extractall(job.folder + "/fmu")
builder = casadi.DaeBuilder("one", job.folder + "/fmu")
states, inputs = builder.get(builder.x()), casadi.vertcat(*(casadi.DM(builder.start(name)) for name in builder.u()))
motion = builder.create("motion", ["x", "u"], ["ode"])
rates = motion(states, inputs)
if not rates.is_regular() or float(casadi.norm_inf(rates)) > 1e-6:
    raise SystemExit("the structure does not rest at its start")
jacobian = motion.jacobian()(states, inputs, rates)[0]
if not jacobian.is_regular() or jacobian.nnz() == 0:
    raise SystemExit("there is no Jacobian")
finish([], note=f"derivatives and a Jacobian of {jacobian.nnz()} entries; events are unknown to it")

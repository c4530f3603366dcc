from .api import Equilibrium as Equilibrium
from .api import Run as Run
from .api import build as build
from .api import equilibrium as equilibrium
from .api import export_scene as export_scene
from .api import import_scene as import_scene
from .api import load as load
from .api import modes as modes
from .api import read_inputs as read_inputs
from .api import scenes as scenes
from .api import simulate as simulate
from .api import view as view

__version__: str

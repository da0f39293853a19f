"""Every Python process imports this first, under a backend: it takes heyoka away, or changes how heyoka compiles."""

import json
import os
import sys
from functools import wraps
from importlib.abc import MetaPathFinder
from importlib.util import find_spec


def compile_with(heyoka, options):
    """Have both of heyoka's compilers that the package calls take ``options``, where the call says nothing else."""
    for name in ("taylor_adaptive", "cfunc"):
        setattr(heyoka, name, _with(getattr(heyoka, name), options))


def _with(function, options):
    @wraps(function)
    def compiled(*arguments, **settings):
        return function(*arguments, **(options | settings))

    return compiled


class OnImport(MetaPathFinder):
    """Finds heyoka where it is, and changes it once it is loaded."""

    def __init__(self, options):
        self.options = options
        self.searching = False

    def find_spec(self, name, path=None, target=None):
        """Spec of heyoka, whose loader then calls `compile_with`."""
        if name != "heyoka" or self.searching:
            return None
        self.searching = True
        spec = find_spec(name)
        self.searching = False
        if spec is not None:
            execute = spec.loader.exec_module

            def execute_and_change(module):
                execute(module)
                compile_with(module, self.options)

            spec.loader.exec_module = execute_and_change
        return spec


options = json.loads(os.environ.get("LOOPING_PENDULUM_TEST_HEYOKA", "{}"))
if options is None:
    sys.modules["heyoka"] = None  # an import then fails as if it were not installed
elif options:
    sys.meta_path.insert(0, OnImport(options))

"""Compilation of device functions: only what the kernels that call them need.

numba compiles each function into a library: it optimises the function together with everything that
it calls, translates that to machine code, and gives a copy of the optimised code to the libraries
of the callers. Device functions are called by kernels only, so that their machine code is never
used, and the kernel's own optimisation covers them again. Here a device function's library only
collects its code; optimisation and translation take place once, in the kernel. Results are the same
bits: optimisation does not reorder floating-point operations.

This replaces methods of numba's classes that are not public. If one is missing,
:func:`device_compiler` selects numba's own way, which is slower.
"""

from typing import Any

from numba.core import compiler, compiler_machinery, typed_passes
from numba.core.codegen import JITCodeLibrary

_REPLACED = (
    "_optimize_final_module",
    "_finalize_final_module",
    "_finalize_dynamic_globals",
    "get_pointer_to_function",
    "codegen",
)


class _DeviceCodegen:
    """A code generator whose functions have no address, so that no environment is set in them."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, _name: str, _environment: Any) -> None:
        """Nothing to set: the kernel has the environments that it needs."""


class _DeviceLibrary(JITCodeLibrary):
    """Code of a device function and of what it calls, to be linked into kernels."""

    def _optimize_final_module(self) -> None:
        """The kernel's library is optimised."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, _name: str) -> int:
        """0: the function has no machine code."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """The code generator, without environments."""
        return _DeviceCodegen(self._codegen)


@compiler_machinery.register_pass(mutates_CFG=False, analysis_only=True)
class _UseDeviceLibrary(compiler_machinery.FunctionPass):
    """Let the following passes generate code into a device library."""

    _name = "use_device_library"

    def __init__(self) -> None:
        pass

    def run_pass(self, state: Any) -> bool:
        """Set the library of the function; True: the state has changed."""
        state.library = _DeviceLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return True


class _DeviceCompiler(compiler.CompilerBase):
    """numba's compiler, with a device library."""

    def define_pipelines(self) -> list[Any]:
        """The one pipeline: numba's, without a fallback to Python objects."""
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_UseDeviceLibrary, typed_passes.NopythonTypeInference)
        passes.finalize()
        return [passes]


def device_compiler() -> dict[str, Any]:
    """Options of ``numba.njit`` for device functions."""
    if all(hasattr(JITCodeLibrary, name) for name in _REPLACED):
        return {"pipeline_class": _DeviceCompiler}
    return {}

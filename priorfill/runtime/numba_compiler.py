"""Functions compiled by numba into object files; see `priorfill.runtime.compiled`."""

from __future__ import annotations

from types import FunctionType
from typing import TYPE_CHECKING, Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba import njit, typeof, types
from numba.core import config
from numba.core.registry import cpu_target

from priorfill.errors import OptionError
from priorfill.runtime.lapack import ExternalRoutine
from priorfill.runtime.machine_code import RESULTS, START, pack

if TYPE_CHECKING:
    from priorfill.runtime.compiled import CompiledFunction

__all__ = ["add_symbols", "compile_function"]

_WORD, _STATUS = ir.IntType(64), ir.IntType(32)


def add_symbols() -> None:
    """Make known to LLVM what compiled code may call in numba."""
    cpu_target.target_context.refresh()


def compile_function(compiled: CompiledFunction, arguments: tuple[Any, ...]) -> bytes:
    """Return the code of a function for arguments of these types, as `machine_code.load` takes it.

    Parameters
    ----------
    compiled : CompiledFunction
        The function.
    arguments : tuple
        Of a call.

    Raises
    ------
    OptionError
        If numba is not to compile.
    TypeError
        If the function returns something else than `machine_code.RESULTS` names.
    """
    if getattr(config, "DISABLE_JIT", False):  # set when it is imported
        raise OptionError("NUMBA_DISABLE_JIT keeps numba from compiling; unset it")
    types = tuple(map(typeof, arguments))
    dispatcher = _dispatcher(compiled, {})
    dispatcher.compile(types)
    found = dispatcher.overloads[types]
    result = str(found.signature.return_type)
    if result not in RESULTS:
        raise TypeError(f"{compiled.__name__} returns {result}, which cannot be read")
    wrapper, name, words = _wrapper(found)
    library = found.library
    module = llvm.parse_bitcode(library._final_module.as_bitcode())
    module.link_in(llvm.parse_assembly(str(wrapper)))
    if not any("NRT_MemInfo_alloc" in function.name for function in module.functions):
        module.link_in(llvm.parse_assembly(str(_no_destructor())))
    return pack(name, result, words, library._codegen._tm.emit_object(module))


def _dispatcher(compiled: CompiledFunction, made: dict[CompiledFunction, Any]) -> Any:
    """Return a function as numba has it, which calls others as numba has them."""
    if compiled not in made:
        plain = compiled.function
        values = dict(plain.__globals__)
        for name, value in compiled.globals_used():
            if isinstance(value, type(compiled)):
                values[name] = _dispatcher(value, made)
            elif isinstance(value, ExternalRoutine):
                llvm.add_symbol(value.symbol, value.address)  # numba loads what it compiles
                values[name] = types.ExternalFunction(
                    value.symbol, types.void(*[types.uintp] * value.arguments)
                )
        copy = FunctionType(plain.__code__, values, plain.__name__, plain.__defaults__)
        copy.__module__, copy.__qualname__ = plain.__module__, plain.__qualname__
        made[compiled] = njit(**compiled.options)(copy)
    return made[compiled]


def _no_destructor() -> ir.Module:
    """Return a module with what would free an array that numba owns.

    The arrays of arguments have no owner, so it is never called in code that makes none.
    """
    module = ir.Module("no_destructor")
    module.triple = llvm.get_process_triple()
    kind = ir.FunctionType(ir.VoidType(), [ir.IntType(8).as_pointer()])
    function = ir.Function(module, kind, "NRT_MemInfo_call_dtor")
    ir.IRBuilder(function.append_basic_block("entry")).ret_void()
    return module


def _wrapper(found: Any) -> tuple[ir.Module, str, str]:
    """Return a module with a function that unpacks arguments, its name, and kinds of the words."""
    context = found.target_context
    kind = context.call_conv.get_function_type(found.signature.return_type, found.signature.args)
    module = ir.Module("wrapper")
    module.triple = llvm.get_process_triple()
    target = ir.Function(module, kind, found.fndesc.llvm_func_name)
    name = f"{START}_{found.fndesc.llvm_func_name}"
    start = ir.Function(
        module, ir.FunctionType(_STATUS, [_WORD.as_pointer(), _WORD.as_pointer()]), name
    )
    builder = ir.IRBuilder(start.append_basic_block("entry"))
    packed, result = start.args
    to_result, to_error, *parameters = kind.args
    error = builder.alloca(_WORD)
    values, words = [], ""
    for at, parameter in enumerate(parameters):
        word = builder.load(builder.gep(packed, [ir.Constant(_WORD, at)]))
        if isinstance(parameter, ir.DoubleType):
            words += "d"
            values.append(builder.bitcast(word, parameter))
        else:
            words += "q"
            is_pointer = isinstance(parameter, ir.PointerType)
            values.append(builder.inttoptr(word, parameter) if is_pointer else word)
    passed = [builder.bitcast(result, to_result), builder.bitcast(error, to_error), *values]
    builder.ret(builder.call(target, passed))
    return module, name, words

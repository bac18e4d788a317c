"""Python functions that a compiled program calls on the CPU, through XLA's foreign-function ABI.

`jax.pure_callback` turns its arguments into JAX arrays and back, which takes longer than stepping a
few simulations, and waits for a free thread of XLA's pool: two large ones on two cores wait for
each other for ever. It also puts the function's address into the program, so nothing that calls it
is kept in the compilation cache. A custom call passes the program's own memory and is found by its
name; the ABI (`xla/ffi/api/c_api.h`, in jaxlib) is plain C, so `ctypes` is all that it needs.
"""

import ctypes
import math
import threading
from collections.abc import Callable
from ctypes import POINTER, Structure, c_char_p, c_int, c_int64, c_size_t, c_void_p

import jax
import jax.numpy as jnp
import numpy as np

# Fills `out` [N, O] from `rows` [N, I], both float32 and the program's own memory.
RowFunction = Callable[[np.ndarray, np.ndarray], None]

_ABI = 0  # the major version; minor ones only add to the end of a structure
_METADATA = 1  # XLA_FFI_Extension_Metadata: asked for at registration, in place of a call
_INTERNAL = 13  # XLA_FFI_Error_Code_INTERNAL
_Pointer = c_void_p  # to what is not looked into


class _Version(Structure):
    _fields_ = (
        ("struct_size", c_size_t), ("extension", _Pointer), ("major", c_int), ("minor", c_int)
    )  # fmt: skip


class _Metadata(Structure):
    _fields_ = (("struct_size", c_size_t), ("version", _Version))  # and what has a default


class _Extension(Structure):
    _fields_ = (
        ("struct_size", c_size_t), ("type", c_int), ("next", _Pointer),
        ("metadata", POINTER(_Metadata)),
    )  # fmt: skip


class _ErrorArguments(Structure):
    _fields_ = (
        ("struct_size", c_size_t), ("extension", _Pointer), ("message", c_char_p), ("code", c_int)
    )  # fmt: skip


class _Api(Structure):
    _fields_ = (
        ("struct_size", c_size_t), ("extension", _Pointer), ("version", _Version),
        ("internal", _Pointer),
        ("create_error", ctypes.CFUNCTYPE(c_void_p, POINTER(_ErrorArguments))),
    )  # fmt: skip


class _Buffer(Structure):
    _fields_ = (
        ("struct_size", c_size_t), ("extension", _Pointer), ("dtype", c_int), ("data", _Pointer),
        ("rank", c_int64), ("dims", POINTER(c_int64)),
    )  # fmt: skip


class _Buffers(Structure):
    _fields_ = (
        ("struct_size", c_size_t), ("extension", _Pointer), ("size", c_int64), ("types", _Pointer),
        ("buffers", POINTER(POINTER(_Buffer))),
    )  # fmt: skip


class _CallFrame(Structure):
    _fields_ = (
        ("struct_size", c_size_t), ("extension", POINTER(_Extension)), ("api", POINTER(_Api)),
        ("context", _Pointer), ("stage", c_int), ("arguments", _Buffers), ("results", _Buffers),
    )  # fmt: skip


_Handler = ctypes.CFUNCTYPE(c_void_p, POINTER(_CallFrame))
_registered: dict[str, object] = {}  # handlers by name: XLA calls them as long as the process lives
_lock = threading.Lock()


def register(name: str, function: RowFunction) -> None:
    """Make a function known to compiled programs; they may come from the compilation cache.

    Args:
      name: what programs call it. Whoever registers a name again means the same function, so the
        name must tell everything its result depends on.
      function: called by several threads at the same time when several devices run.
    """
    with _lock:
        if name in _registered:
            return

        @_Handler
        def handler(frame: "ctypes._Pointer[_CallFrame]") -> int | None:
            call = frame.contents
            if call.extension and call.extension.contents.type == _METADATA:
                version = call.extension.contents.metadata.contents.version
                version.major, version.minor = _ABI, call.api.contents.version.minor
                return None
            try:
                function(_rows(call.arguments), _rows(call.results))
            except Exception as error:  # whatever it is, XLA has to hear of it
                return _error(call, f"{type(error).__name__}: {error}")
            return None

        jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(handler), platform="cpu")
        _registered[name] = handler


def call(name: str, row: jax.Array, out_size: int, function: RowFunction) -> jax.Array:
    """Return what a registered function makes of `row` [I]: [out_size], float32.

    The function reads the program's memory as float32, so that is what the row is made of first.

    Every `vmap` around it ends up in one call, with a row for each. Where the program runs on a
    device of another kind, the rows travel to the host and back.
    """
    row = row.astype(jnp.float32)
    out = jax.ShapeDtypeStruct((out_size,), jnp.float32)

    def elsewhere(row: np.ndarray) -> np.ndarray:
        rows = np.asarray(row)
        result = np.empty((*rows.shape[:-1], out_size), np.float32)
        function(rows.reshape(-1, rows.shape[-1]), result.reshape(-1, out_size))
        return result

    return jax.lax.platform_dependent(
        row,
        cpu=jax.ffi.ffi_call(name, out, vmap_method="broadcast_all"),
        default=lambda row: jax.pure_callback(elsewhere, out, row, vmap_method="broadcast_all"),
    )


def _rows(buffers: _Buffers) -> np.ndarray:
    """Return the one buffer of a call as a matrix."""
    buffer = buffers.buffers[0].contents
    *leading, columns = buffer.dims[: buffer.rank]
    size = math.prod(leading) * columns
    memory = (ctypes.c_float * size).from_address(buffer.data)
    return np.frombuffer(memory, np.float32).reshape(-1, columns)


def _error(call: _CallFrame, message: str) -> int | None:
    arguments = _ErrorArguments(ctypes.sizeof(_ErrorArguments), None, message.encode(), _INTERNAL)
    return call.api.contents.create_error(ctypes.byref(arguments))

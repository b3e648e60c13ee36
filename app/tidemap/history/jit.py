"""How kernels are compiled: cached on disk, without the GIL, sums kept in their order."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import config, njit, types
from numba.cpython.unsafe.numbers import trailing_zeros
from numba.extending import intrinsic

# Numbers that lie side by side, as the two parts of a complex one, go through one instruction; sums keep their order.
# numba has no type for its settings.
setattr(config, "SLP_VECTORIZE", 1)  # noqa: B010

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile on first use, every operation rounded as written: results are the same bit for bit
    wherever in an array they are computed."""
    return cast(Function, njit(cache=True, nogil=True, error_model="numpy")(function))


def fused_kernel(function: Function) -> Function:
    """As `kernel`, but a product and a sum may become one instruction; for loops of fixed length."""
    options: Any = {"fastmath": {"contract"}, "error_model": "numpy"}
    return cast(Function, njit(cache=True, nogil=True, **options)(function))


def _load_word(typing_context: Any, plane: Any, byte: Any) -> Any:
    """Eight bytes of a C-contiguous uint8 array from flat position `byte` on, as one little-endian
    uint64, without bounds check.

    Written as shifts of single bytes the compiler makes eight loads of it.
    """

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        address = builder.gep(array.data, [arguments[1]])
        word = context.get_value_type(types.uint64)
        return builder.load(builder.bitcast(address, word.as_pointer()), align=1)

    return types.uint64(plane, types.intp), code


load_word = cast(Callable[[Any, int], Any], intrinsic(_load_word))
lowest = cast(Callable[[Any], Any], trailing_zeros)
"""The position of the lowest set bit of a word that is not zero."""

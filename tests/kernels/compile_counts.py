"""What the compilation of a kernel consists of, in counts that are the same on every machine.

Seconds of compilation differ by machine and load (`make bench` measures them); these counts do not: functions that
numba types and lowers, scalars that the LLVM code hands over at calls (numba passes each array as about seven), and
lines of LLVM code before optimisation, of a kernel and of all that is linked into it.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

from numba.core.codegen import JITCodeLibrary

NAMES = ("functions", "scalars", "lines")
CALL = re.compile(r"\bcall [^(]*[@%]N\((.*)\)")


def count_in_code(text: str) -> Counter[str]:
    """Functions, scalars handed over at calls and lines of LLVM code."""
    found: Counter[str] = Counter()
    for line in text.splitlines():
        found["lines"] += bool(line.strip())
        found["functions"] += line.startswith("define ")
        call = CALL.search(re.sub(r'"[^"]*"', "N", line)) if "call " in line else None
        if call and call[1]:
            arguments = re.sub(r"[{(\[<][^{}()\[\]<>]*[})\]>]", "", call[1])
            found["scalars"] += arguments.count(",") + 1
    return found


def install() -> None:
    """Let every library of numba's keep the counts of its code; once a process, before the first compilation."""
    add = JITCodeLibrary.add_ir_module

    def counted(self: Any, ir_module: Any) -> None:
        self.counts = getattr(self, "counts", Counter()) + count_in_code(str(ir_module))
        add(self, ir_module)

    JITCodeLibrary.add_ir_module = counted  # type: ignore[method-assign]


def counts(library: Any) -> Counter[str] | None:
    """Sum over a library and all that is linked into it; None for code that comes from the cache."""
    if not hasattr(library, "counts"):
        return None
    waiting, seen = [library], {}
    while waiting:
        one = waiting.pop()
        if id(one) not in seen:
            seen[id(one)] = getattr(one, "counts", Counter())
            waiting += one._linking_libraries
    return sum(seen.values(), Counter())


def largest(kernel: Any) -> dict[str, int]:
    """Largest counts of all variants of a kernel that this process has compiled."""
    found = [one for result in kernel.overloads.values() if (one := counts(result.library))]
    return {name: max(one[name] for one in found) for name in NAMES} if found else {}

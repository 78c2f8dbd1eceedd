"""A file that is changed in place, and whose changes arrive whole or not at all.

HDF5 changes a file in many places at once. A process that is killed in between, or whose disk is full, leaves a file
that nobody can read any more, with all that stood in it before. So HDF5 does not write to the disk here, but into this
object, which keeps the pages that change. `commit` writes them, all together, as a journal beside the file (in one
step, see `emclutch.results.atomic_file`), then into the file, and removes the journal. Killed before the journal is
there, the file is the former one; killed later, whoever opens it next finds the journal and reads its pages in place of
the file's. It is the write-ahead log of data bases (J. Gray, A. Reuter, "Transaction Processing", 1993, section 9.3),
of one transaction at a time.

Cost: what changes is written twice. For one writer; readers may come at any time, also while it commits.
"""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np

from emclutch.results.atomic_file import replace_bytes

PAGE = 4096  # bytes


class JournalledFile(io.RawIOBase):
    """The bytes of a file with the changes that were made to it, of which the disk learns by `commit`.

    Parameters
    ----------
    path : Path
        Of the file, which must exist.

    Raises
    ------
    OSError
        It cannot be read, or its journal is none.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path, self._journal = path, journal_of(path)
        self._file = path.open("rb")
        self._size = self._kept = os.fstat(self._file.fileno()).st_size  # of its bytes as they stand, so many are left
        self._pages: dict[int, bytearray] = {}
        self._at = 0
        if self._journal.is_file():
            self._take_journal()

    def commit(self) -> None:
        """Write the changes.

        Raises
        ------
        OSError
            The disk does not take them: they are in the file as it is read here, or not at all.
        """
        if not self._pages and self._size == self._kept == os.fstat(self._file.fileno()).st_size:
            return
        numbers = sorted(self._pages)
        content = io.BytesIO()
        pages = np.frombuffer(b"".join(self._pages[number] for number in numbers), dtype=np.uint8)
        np.savez(content, size=self._size, kept=self._kept, numbers=np.array(numbers), pages=pages)
        replace_bytes(self._journal, content.getbuffer())
        with self._path.open("r+b") as file:
            file.truncate(self._kept)
            for number in numbers:
                file.seek(number * PAGE)
                file.write(self._pages[number][: self._size - number * PAGE])
            file.truncate(self._size)
            file.flush()
            os.fsync(file.fileno())
        self._journal.unlink()
        self._pages.clear()
        self._kept = self._size

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place; HDF5 counts from the begin, and asks for the end."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer) -> int:
        """Bytes from the present place on; fewer than asked for at the file's end."""
        into = memoryview(buffer).cast("B")
        count = max(0, min(len(into), self._size - self._at))
        done = 0
        while done < count:
            number, begin = divmod(self._at, PAGE)
            part = min(PAGE - begin, count - done)
            into[done : done + part] = self._page(number)[begin : begin + part]
            self._at += part
            done += part
        return count

    def write(self, content) -> int:
        """Change bytes from the present place on."""
        data = memoryview(content).cast("B")
        done = 0
        while done < len(data):
            number, begin = divmod(self._at, PAGE)
            part = min(PAGE - begin, len(data) - done)
            page = self._pages.setdefault(number, self._page(number))
            page[begin : begin + part] = data[done : done + part]
            self._at += part
            done += part
        self._size = max(self._size, self._at)
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        """Cut the file off, or make it longer by zeros."""
        self._size = self._at if size is None else size
        self._kept = min(self._kept, self._size)
        last, rest = divmod(self._size, PAGE)
        self._pages = {number: page for number, page in self._pages.items() if number < last + (rest > 0)}
        if last in self._pages:
            self._pages[last][rest:] = bytes(PAGE - rest)
        return self._size

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def close(self) -> None:
        """Close without writing what was not committed."""
        self._file.close()
        super().close()

    def _page(self, number: int) -> bytearray:
        """The bytes of a page, filled up by zeros at the file's end."""
        if number in self._pages:
            return self._pages[number]
        page, begin = bytearray(PAGE), number * PAGE
        self._file.seek(begin)
        left = self._file.read(max(0, min(PAGE, self._kept - begin)))
        page[: len(left)] = left
        return page

    def _take_journal(self) -> None:
        """The pages of a commit that was cut off."""
        try:
            with self._journal.open("rb") as stream, np.load(stream) as kept:
                self._size, self._kept, pages = int(kept["size"]), int(kept["kept"]), kept["pages"].reshape(-1, PAGE)
                self._pages = {int(n): bytearray(page) for n, page in zip(kept["numbers"], pages, strict=True)}
        except FileNotFoundError:  # its writer has just finished
            self._size = self._kept = os.fstat(self._file.fileno()).st_size
        except Exception as error:  # whatever numpy and zipfile find in a foreign file
            self._file.close()
            raise OSError(f"{self._journal} is no journal of changes ({error})") from error


def journal_of(path: Path) -> Path:
    """The journal beside a file."""
    return path.with_name(f"{path.name}.journal")

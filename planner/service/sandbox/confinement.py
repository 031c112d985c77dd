"""Confinement of a process before it reads an uploaded file: limits, Landlock and seccomp.

Landlock: what a process may open, and that it may connect to nothing (Linux; docs.kernel.org, userspace-api).

seccomp: which calls of the system a process may make (Linux; man 2 seccomp).

What reading and computing take is allowed, everything else answered with EACCES: no sockets, no new processes, no other
programs, no signals, nothing written to a name. A call is filtered by its number, which differs between processors.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import platform
import signal
import struct
import sys
import sysconfig
import time
from collections.abc import Iterable
from pathlib import Path

LANDLOCK_CREATE_RULESET, LANDLOCK_ADD_RULE, LANDLOCK_RESTRICT_SELF = 444, 445, 446
"""Calls of the system, the same on every processor."""
LANDLOCK_VERSION_FLAG = 1 << 0  # asks which Landlock this is
LANDLOCK_PATH_BENEATH = 1
LANDLOCK_READ_RIGHTS = (1 << 2) | (1 << 3)  # files, and folders
LANDLOCK_FILE_RIGHTS = {1: (1 << 13) - 1, 2: (1 << 14) - 1, 3: (1 << 15) - 1, 5: (1 << 16) - 1}
"""File access rights by Landlock version."""
LANDLOCK_TCP_RIGHTS = (1 << 0) | (1 << 1)  # TCP, from version 4
LANDLOCK_SCOPES = (1 << 0) | (1 << 1)  # sockets without a file, and signals, from version 6
PR_SET_SECCOMP, SECCOMP_MODE_FILTER = 22, 2  # of prctl
AUDIT_ARCHITECTURES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
ALLOWED_CALLS: dict[str, tuple[int | None, int | None]] = {
    # files and folders
    "open": (2, None), "openat": (257, 56), "close": (3, 57), "read": (0, 63), "readv": (19, 65), "pread64": (17, 67),
    "write": (1, 64), "writev": (20, 66), "lseek": (8, 62), "dup": (32, 23), "dup2": (33, None), "dup3": (292, 24),
    "fadvise64": (221, 223), "stat": (4, None), "fstat": (5, 80), "lstat": (6, None), "newfstatat": (262, 79),
    "statx": (332, 291), "statfs": (137, 43), "fstatfs": (138, 44), "access": (21, None), "faccessat": (269, 48),
    "faccessat2": (439, 439), "readlink": (89, None), "readlinkat": (267, 78), "getdents64": (217, 61),
    "getcwd": (79, 17), "chdir": (80, 49), "poll": (7, None), "ppoll": (271, 73),
    # memory
    "mmap": (9, 222), "mprotect": (10, 226), "munmap": (11, 215), "mremap": (25, 216), "mincore": (27, 232),
    "madvise": (28, 233), "brk": (12, 214),
    # signals to itself, threads and the end
    "rt_sigaction": (13, 134), "rt_sigprocmask": (14, 135), "rt_sigreturn": (15, 139), "sigaltstack": (131, 132),
    "futex": (202, 98), "set_robust_list": (273, 99), "set_tid_address": (218, 96), "rseq": (334, 293),
    "membarrier": (324, 283), "sched_yield": (24, 124), "sched_getaffinity": (204, 123), "arch_prctl": (158, None),
    "exit": (60, 93), "exit_group": (231, 94),
    # times and what the process is
    "nanosleep": (35, 101), "clock_nanosleep": (230, 115), "clock_gettime": (228, 113), "clock_getres": (229, 114),
    "gettimeofday": (96, 169), "times": (100, 153), "getpid": (39, 172), "getppid": (110, 173), "gettid": (186, 178),
    "getuid": (102, 174), "getgid": (104, 176), "geteuid": (107, 175), "getegid": (108, 177), "getrlimit": (97, 163),
    "getrusage": (98, 165), "getrandom": (318, 278), "sysinfo": (99, 179), "uname": (63, 160),
}  # fmt: skip
"""Allowed system calls, by their numbers on x86_64 and aarch64."""
FCNTL_NUMBERS, CLONE3_NUMBERS = (72, 25), (435, 435)
ALLOWED_FCNTL_COMMANDS = (0, 1, 2, 3, 4, 5, 6, 7, 1030)  # copies, flags and locks; not who is sent signals
BPF_LOAD, BPF_JUMP_EQUAL, BPF_JUMP_GREATER_EQUAL, BPF_RETURN = 0x20, 0x15, 0x35, 0x06
"""Of the classic Berkeley packet filter."""
CALL_NUMBER_OFFSET, ARCHITECTURE_OFFSET, SECOND_ARGUMENT_OFFSET = 0, 4, 24  # where these stand in what the filter sees
SECCOMP_KILL, SECCOMP_ALLOW, SECCOMP_ERRNO = 0x80000000, 0x7FFF0000, 0x00050000
X32_CALLS_FROM = 0x40000000  # x86_64 has all calls a second time from here on
PR_SET_PDEATHSIG, PR_SET_NO_NEW_PRIVS = 1, 38  # of prctl
MOST_OPEN_FILES = 64
NICENESS = 5  # of the office and of readers: links and stops come first
OWN_PACKAGES = ("fields", "planner", "reports", "strategies", "vehicle")
SYSTEM_LIBRARY_FOLDERS = ("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/usr/share/zoneinfo")
"""Folders of shared libraries."""


class _LandlockRuleset(ctypes.Structure):
    _fields_ = (("files", ctypes.c_uint64), ("net", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class _PathBeneathRule(ctypes.Structure):
    _pack_ = 1
    _layout_ = "ms"
    _fields_ = (("allowed", ctypes.c_uint64), ("folder", ctypes.c_int32))


def get_landlock_version() -> int:
    """The Landlock version of this system, 0 for none."""
    if not sys.platform.startswith("linux"):
        return 0
    return max(0, int(_load_libc().syscall(LANDLOCK_CREATE_RULESET, None, ctypes.c_size_t(0), LANDLOCK_VERSION_FLAG)))


def restrict_to_folders(folders: Iterable[Path]) -> None:
    """Restrict this process and its children, irrevocably, to reading below these folders.

    Open files stay open. Raises OSError where the system refuses.
    """
    version, libc = get_landlock_version(), _load_libc()
    files = max(rights for since, rights in LANDLOCK_FILE_RIGHTS.items() if since <= version)
    rules = _LandlockRuleset(files, LANDLOCK_TCP_RIGHTS if version >= 4 else 0, LANDLOCK_SCOPES if version >= 6 else 0)
    size = 24 if version >= 6 else 16 if version >= 4 else 8
    created = libc.syscall(LANDLOCK_CREATE_RULESET, ctypes.byref(rules), ctypes.c_size_t(size), 0)
    ruleset = _check_result(created, "Landlock refused")
    for folder in folders:
        folder_descriptor = os.open(folder, os.O_PATH | os.O_CLOEXEC | os.O_DIRECTORY)
        rule = _PathBeneathRule(LANDLOCK_READ_RIGHTS, folder_descriptor)
        added = libc.syscall(LANDLOCK_ADD_RULE, ruleset, LANDLOCK_PATH_BENEATH, ctypes.byref(rule), 0)
        _check_result(added, "Landlock refused")
        os.close(folder_descriptor)
    _check_result(libc.syscall(LANDLOCK_RESTRICT_SELF, ruleset, 0), "Landlock refused")
    os.close(ruleset)


def _load_libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _check_result(result: int, fault: str) -> int:
    """The result of a call of the system; raises OSError where it failed."""
    if result < 0:
        raise OSError(ctypes.get_errno(), fault)
    return result


class _SeccompProgram(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_void_p))


def can_use_seccomp() -> bool:
    """Whether the system calls of this processor are known."""
    return sys.platform.startswith("linux") and platform.machine() in AUDIT_ARCHITECTURES and sys.maxsize > 2**32


def restrict_system_calls() -> None:
    """Restrict this process and its children, irrevocably, to reading and computing.

    The process must have dropped new privileges before. Raises OSError where the system refuses.
    """
    code = b"".join(struct.pack("=HBBI", *each) for each in _build_seccomp_filter(platform.machine()))
    buffer = ctypes.create_string_buffer(code, len(code))
    program = _SeccompProgram(len(code) // 8, ctypes.cast(buffer, ctypes.c_void_p))
    arguments = (ctypes.c_ulong(SECCOMP_MODE_FILTER), ctypes.byref(program), 0, 0)
    _check_result(_load_libc().prctl(PR_SET_SECCOMP, *arguments), "seccomp refused")


def _build_seccomp_filter(machine: str) -> list[tuple[int, int, int, int]]:
    """The BPF program: (code, jump if true, jump if false, value)."""
    column = list(AUDIT_ARCHITECTURES).index(machine)
    steps = [
        (BPF_LOAD, 0, 0, ARCHITECTURE_OFFSET),
        (BPF_JUMP_EQUAL, 1, 0, AUDIT_ARCHITECTURES[machine]),
        (BPF_RETURN, 0, 0, SECCOMP_KILL),
    ]
    steps += [
        (BPF_LOAD, 0, 0, CALL_NUMBER_OFFSET),
        (BPF_JUMP_GREATER_EQUAL, 0, 1, X32_CALLS_FROM),
        (BPF_RETURN, 0, 0, SECCOMP_ERRNO | errno.EACCES),
    ]
    for numbers in ALLOWED_CALLS.values():
        if (number := numbers[column]) is not None:
            steps += [(BPF_JUMP_EQUAL, 0, 1, number), (BPF_RETURN, 0, 0, SECCOMP_ALLOW)]
    # So that the C library takes the older call for new threads, which is refused as it should be.
    steps += [(BPF_JUMP_EQUAL, 0, 1, CLONE3_NUMBERS[column]), (BPF_RETURN, 0, 0, SECCOMP_ERRNO | errno.ENOSYS)]
    steps += [
        (BPF_JUMP_EQUAL, 0, 1 + 2 * len(ALLOWED_FCNTL_COMMANDS), FCNTL_NUMBERS[column]),
        (BPF_LOAD, 0, 0, SECOND_ARGUMENT_OFFSET),
    ]
    for command in ALLOWED_FCNTL_COMMANDS:
        steps += [(BPF_JUMP_EQUAL, 0, 1, command), (BPF_RETURN, 0, 0, SECCOMP_ALLOW)]
    return [*steps, (BPF_RETURN, 0, 0, SECCOMP_ERRNO | errno.EACCES)]


def lower_priority() -> None:
    """Let links and stops come before what this process does, where the system has priorities."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)


def list_missing_protections() -> list[str]:
    """The protections that this system lacks, in words."""
    missing = []
    if get_landlock_version() == 0:
        missing.append("Landlock (a reader could open other files of this user)")
    if not can_use_seccomp():
        missing.append("seccomp (a reader could reach the network)")
    if os.name != "posix":
        missing.append("limits for memory (a reader could take all there is)")
    return missing


def list_library_folders() -> list[Path]:
    """Folders of Python, its packages and the data of PROJ and GDAL."""
    paths: set[str] = {sysconfig.get_path(name) or "" for name in ("stdlib", "platstdlib", "purelib", "platlib")}
    paths |= {one for one in sys.path if Path(one).name in ("lib-dynload", "site-packages", "dist-packages")}
    # Where the packages lie beside other things, as while they are worked on, no more than themselves.
    own_packages = {str(Path(__file__).parents[3] / room) for room in OWN_PACKAGES}
    data: set[str] = {os.environ.get("PROJ_DATA", ""), os.environ.get("PROJ_LIB", "")} - {""}
    folders: list[str] = sorted({*paths, *own_packages, *data, *SYSTEM_LIBRARY_FOLDERS})
    return [Path(one) for one in folders if one and os.path.isdir(one)]


def confine_process(
    folder: Path, libraries: Iterable[Path], memory_bytes: int, computing_s: float, open_descriptor: int | None
) -> None:
    """Confine this process, irrevocably, to reading below these folders.

    Args:
        folder: of the files that are to be read.
        libraries: folders of what reads them.
        memory_bytes: what it may take beyond what it has.
        computing_s: seconds of computing, from now on.
        open_descriptor: what stays open beside 0, 1 and 2, which lead nowhere; None in a process that was not forked
            and so has but its own, those of libraries among them.

    Raises OSError where the system refuses what it offers.
    """
    os.chdir(folder)
    if open_descriptor is not None:
        _close_descriptors(open_descriptor)
    if os.name == "posix":
        _set_resource_limits(memory_bytes, computing_s)
    if not sys.platform.startswith("linux"):
        return
    libc = _load_libc()
    libc.prctl(PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGKILL), 0, 0, 0)
    privileges = libc.prctl(PR_SET_NO_NEW_PRIVS, ctypes.c_ulong(1), 0, 0, 0)
    _check_result(privileges, "new privileges cannot be given up")
    if get_landlock_version():
        restrict_to_folders([folder, *libraries])
    if can_use_seccomp():
        restrict_system_calls()


def _close_descriptors(open_descriptor: int) -> None:
    null_descriptor = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1, 2):
        if standard != open_descriptor:
            os.dup2(null_descriptor, standard)
    most_descriptors = os.sysconf("SC_OPEN_MAX") if hasattr(os, "sysconf") else 1024
    os.closerange(3, max(3, open_descriptor))
    os.closerange(max(3, open_descriptor + 1), min(most_descriptors, 65_536))


def _set_resource_limits(memory_bytes: int, computing_s: float) -> None:
    """Set the resource limits that this system knows."""
    import resource

    used_bytes = 4 * 2**30  # a typical value where the system does not report it
    with contextlib.suppress(OSError, ValueError):
        used_bytes = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    limits = {
        "RLIMIT_AS": used_bytes + memory_bytes,
        "RLIMIT_CPU": int(time.process_time() + computing_s) + 1,
        "RLIMIT_FSIZE": 0,
        "RLIMIT_CORE": 0,
        "RLIMIT_NPROC": 0,
        "RLIMIT_NOFILE": MOST_OPEN_FILES,
    }
    for name, soft in limits.items():
        if hasattr(resource, name):
            # At its soft limit of computing a process gets a signal that says so, at the hard one it is killed.
            hard = soft + 1 if name == "RLIMIT_CPU" else soft
            with contextlib.suppress(ValueError, OSError):
                resource.setrlimit(getattr(resource, name), (soft, hard))

"""Start of an experiment's launchers: broker, accounts, code and servers."""

import os
import shlex
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import SimulationName, is_command, is_python
from swarmwright.experiment.broker_address import drop_unix_sockets
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.launcher_entries import Entries
from swarmwright.servers.broker.credentials import check_environment, prepare
from swarmwright.servers.evaluation.launched.servers import (
    Access,
    Credentials,
    Entry,
    LaunchedServers,
    find_own_address,
    start_embedded,
)
from swarmwright.servers.evaluation.module_code import names_of
from swarmwright.servers.launchers import LAUNCHERS, Code, LauncherOptions, Specification
from swarmwright.servers.rows import ServerUse, ServerUses
from swarmwright.simulations.names import find_environment_copy
from swarmwright.simulations.user_code import parts, trust
from swarmwright.simulations.user_code.changes import choose, list_files
from swarmwright.simulations.user_code.copying import CopiedPart, Copy
from swarmwright.simulations.user_code.parts import Part, read_simulation

_FOLDER = "modules/"
"""Folder of the code of modules within the servers' code."""


def pack_code(
    simulation: str, modules: Sequence[str], options: LauncherOptions
) -> tuple[str, list[str], Code | None]:
    """Pack the code; return the names of simulation and modules relative to it, and the code.

    Installed packages are not packed. Each module in a file gets a folder with its imports, named by their
    SHA-256, so that files of the same name do not collide.

    Raises:
        InputError: a file cannot be read, or there are too many.
    """
    parsed_modules = [SimulationName.parse(module) for module in modules]
    in_files = any(parsed.file is not None for parsed in parsed_modules)
    name, files, programs = _pack_simulation(simulation, options, in_files=in_files)
    names = []
    for module, parsed in zip(modules, parsed_modules, strict=True):
        if parsed.file is None:
            names.append(module)
            continue
        part = _load_part(parsed.file)
        folder = "" if options.code is not None else f"{_FOLDER}{trust.digest_of(part.digests)[:16]}/"
        names.append(parsed.with_file(f"{folder}{part.main}"))
        files.update({f"{folder}{path}": source.data for path, source in part.files.items()})
    size = sum(map(len, files.values()))
    if size > parts.LARGEST_BYTES:
        raise parts.make_size_error(size)
    travels = files and options.code is None
    return name, names, Code.from_files(files, programs) if travels else None


def _load_part(path: Path) -> Part:
    """Return the source of a file; for a run's copy the original, if it is unchanged."""
    held = Copy.find_containing(path)
    return Part.from_file("", path.name, path) if held is None else choose(*held).part


def _pack_simulation(
    simulation: str, options: LauncherOptions, *, in_files: bool
) -> tuple[str, dict[str, bytes], set[str]]:
    """Return the simulation's name, its files by path, and which of them are programs.

    in_files: whether modules in files are packed, too.
    """
    name, part = _find_source(simulation) if is_python(simulation) else (simulation, None)
    if part is None:
        _refuse_files(options, in_files=in_files)
        return simulation, {}, set()
    if options.code is not None:
        return name, {}, set()
    files = {name_in_code: source.data for name_in_code, source in part.files.items()}
    programs = {
        name_in_code for name_in_code, source in part.files.items() if os.access(source.origin, os.X_OK)
    }
    home = parts.get_home(part)
    for path in parts.find_named_files(home, options.files):
        files.setdefault(path.relative_to(home).as_posix(), parts.read_file(path))
    return name, files, programs


def _find_source(simulation: str) -> tuple[str, Part | None]:
    """Return a simulation's name relative to its code, and its source.

    For a run's copy, use the original if it is unchanged, as it has further files beside it.
    """
    parsed = SimulationName.parse(simulation)
    environment = find_environment_copy(simulation)
    if environment is not None:
        copy, record = environment
        return record.component, choose(copy, record).part
    held = None if parsed.file is None else Copy.find_containing(parsed.file.absolute())
    part = (
        read_simulation(simulation) if held is None or _differs(simulation, held[1]) else choose(*held).part
    )
    if part is None or parsed.file is None:
        return simulation, part
    return parsed.with_file(part.main if part.module is None else part.module), part


def _differs(simulation: str, record: CopiedPart) -> bool:
    """Whether a command differs from the run's, although it uses the run's files."""
    if not is_command(simulation):
        return False
    now = read_simulation(simulation)
    return now is None or now.digests.get(record.main) != record.digests[record.main]


def check_local_options(simulation: str, options: LauncherOptions) -> None:
    """Raise InputError for options about copied code, which local servers do not use."""
    if options.code is not None:
        raise InputError(
            f"servers: code: has no effect, as servers of {options.launcher} run on this machine with the "
            "original files; leave it out"
        )
    if not is_python(simulation):
        _refuse_files(options, in_files=False)


def _refuse_files(options: LauncherOptions, *, in_files: bool) -> None:
    """Raise InputError if files or code are configured but there is no code to copy.

    in_files: whether modules in files are packed.
    """
    if options.files or (options.code is not None and not in_files):
        key = "files" if options.files else "code"
        raise InputError(
            f"servers: {key}: has no effect, as the simulation is installed and not copied; leave it out"
        )


MAX_EMBEDDED = 4_000
"""Upper limit of servers for the embedded broker, which admits 4,096 clients."""


def start(
    stack: ExitStack,
    experiment: Experiment,
    entries: Entries,
    broker: str | None,
    earlier: ServerUses = MappingProxyType({}),
    machines: Mapping[str, Any] | None = None,
) -> LaunchedServers:
    """Start the servers of all entries; they end with the stack.

    Args:
        stack: ends broker and servers.
        experiment: gives the simulation.
        entries: the launchers' options.
        broker: address of an external broker; None to start the embedded one.
        earlier: use of servers in earlier sessions of the run, which counts for budgets.
        machines: specification of machines with Python modules, whose code the servers need.

    Raises:
        InputError: the code cannot be packed, credentials cannot be read, or there are too many servers.
        RunError: a launcher cannot be used, or no server starts; with the launcher's message.
    """
    names = _names(entries)
    modules = [] if machines is None else names_of([machines])
    hosts = {name: _host(entry) for name, entry in zip(names, entries, strict=True)}
    if broker is None:
        most = sum(entry.max_count for entry in entries)
        if most > MAX_EMBEDDED:
            raise InputError(
                f"servers: {most} servers are too many for the embedded broker, which admits {MAX_EMBEDDED}; "
                "start another broker and set it with broker or --broker"
            )
        check_environment(credentials=False)
        access = start_embedded(
            stack, list(hosts.values()), names, port=_port(entries), prefix=experiment.prefix
        )
    else:
        prepare(broker)
        access = Access(broker)
    launchers = {}
    for name, options in zip(names, entries, strict=True):
        component = LAUNCHERS.get(options.launcher)
        specification = _make_specification(
            experiment,
            options,
            access,
            name,
            None if broker is not None else hosts[name],
            is_local=component.is_here,
            modules=modules,
        )
        launchers[name] = Entry(
            name, component(options, specification), options, earlier=earlier.get(name, ServerUse())
        )
    return stack.enter_context(LaunchedServers(list(launchers.values()), access, experiment.prefix))


def _names(entries: Entries) -> list[str]:
    """Return a name for each entry: its launcher's, numbered from the second use."""
    names: list[str] = []
    for entry in entries:
        number = 1 + sum(name.partition("-")[0] == entry.launcher for name in names)
        names.append(entry.launcher if number == 1 else f"{entry.launcher}-{number}")
    return names


def _host(options: LauncherOptions) -> str:
    if options.broker_host is not None:
        return options.broker_host
    return "127.0.0.1" if LAUNCHERS.get(options.launcher).is_here else find_own_address()


def _port(entries: Entries) -> int | None:
    ports = {entry.broker_port for entry in entries} - {None}
    if len(ports) > 1:
        raise InputError(
            "servers: broker_port: differs between launchers, which share the embedded broker; give one port"
        )
    return ports.pop() if ports else None


def _make_specification(
    experiment: Experiment,
    options: LauncherOptions,
    access: Access,
    name: str,
    host: str | None,
    *,
    is_local: bool,
    modules: Sequence[str],
) -> Specification:
    simulation, code = experiment.simulation, None
    if is_local:
        check_local_options(simulation, options)
    else:
        simulation, modules, code = pack_code(simulation, modules, options)
    external = _credentials(options) if host is None else None
    credentials = external or access.servers.get(name, Credentials())
    address = access.address_for(host)
    if not is_local:
        address = drop_unix_sockets(address)
    if not address:
        raise InputError(
            f"broker: servers of {options.launcher} run on other machines, which cannot use a Unix socket; "
            "give a network address, such as mqtts://HOST:8883"
        )
    return Specification(
        simulation=simulation,
        broker=address,
        prefix=experiment.prefix,
        step_timeout=experiment.timeouts.step,
        username=credentials.username,
        password=credentials.password,
        authority=credentials.authority,
        certificate=credentials.certificate,
        key=credentials.key,
        code=code,
        modules=modules,
        sources=list_files(simulation) if is_local and is_python(simulation) else {},
        environment={**experiment.timeouts.variables(), **options.environment},
        label=f"swarmwright-{experiment.label}",
    )


def _credentials(options: LauncherOptions) -> Credentials:
    """Return the servers' credentials for an external broker, from a file or this process."""
    if options.credentials is None:
        return Credentials.from_environment(os.environ, "the environment")
    file = Path(options.credentials)
    label = f"servers: credentials: {file}"
    try:
        words = shlex.split(file.read_text(encoding="utf-8"), comments=True)
    except OSError as error:
        raise InputError(f"{label}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{label}: is not a file of variables: {error}") from error
    variables = dict(word.split("=", 1) for word in words if "=" in word)
    credentials = Credentials.from_environment(variables, label)
    account = credentials.username is not None and credentials.password is not None
    if not account and (credentials.certificate is None or credentials.key is None):
        raise InputError(
            f"{label}: has no SWARMWRIGHT_USERNAME with SWARMWRIGHT_PASSWORD or SWARMWRIGHT_PASSWORD_FILE, "
            "and no SWARMWRIGHT_CERTIFICATE_FILE with SWARMWRIGHT_KEY_FILE; `swarmwright broker --init` "
            "writes files with accounts"
        )
    return credentials

"""The embedded broker for this user only, with an account created at its start."""

import secrets
from contextlib import ExitStack
from dataclasses import dataclass, field, replace

from swarmwright import _engine
from swarmwright.common.errors import engine_errors
from swarmwright.common.processes import allow_more_open_files
from swarmwright.servers.broker.credentials import CREDENTIALS

_PASSWORD_BYTES = 32


@dataclass(frozen=True)
class Account:
    """An account of a broker for the duration of its run.

    Attributes:
        username: random.
        password: must not appear in arguments of programs, which all users can list.
        is_published: whether other programs of this user find the account by themselves.
    """

    username: str
    password: str = field(repr=False)
    is_published: bool = False

    @property
    def variables(self) -> dict[str, str]:
        """Environment variables for this user's programs.

        Empty for a published account, so that the environment's credentials stay for other brokers; otherwise
        those are unset.
        """
        if self.is_published:
            return {}
        return {
            **dict.fromkeys(CREDENTIALS, ""),
            "SWARMWRIGHT_USERNAME": self.username,
            "SWARMWRIGHT_PASSWORD": self.password,
        }


def create_account() -> Account:
    """Create an account with a random name and password."""
    return Account(f"user-{secrets.token_hex(8)}", secrets.token_urlsafe(_PASSWORD_BYTES))


def start_private(stack: ExitStack, port: int = 0) -> tuple[str, Account]:
    """Start a broker on loopback that ends with the stack and admits only programs of this user.

    This process and other programs of the user find the account by themselves, see `_engine.Broker.publish`;
    programs in other languages need name and password in their environment.

    Args:
        stack: ends it.
        port: 0 for any.

    Returns:
        Its address and its account.

    Raises:
        RunError: the port is taken.
    """
    account = create_account()
    allow_more_open_files()
    with engine_errors():
        broker = _engine.Broker(port=port, accounts=[(account.username, account.password)])
    stack.callback(broker.stop)
    _, problem = broker.publish(account.username, account.password)
    return broker.url, replace(account, is_published=problem is None)

"""The embedded broker as this user alone can use it: with an account that is made when it starts."""

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
    """A user of one broker, for as long as that runs.

    Attributes:
        username: random, too.
        password: never put it into arguments of programs, which all users can list.
        is_published: whether other programs of the user find it by themselves.

    """

    username: str
    password: str = field(repr=False)
    is_published: bool = False

    @property
    def variables(self) -> dict[str, str]:
        """Environment variables with which this user's programs are admitted.

        None where they find the account: the environment's credentials are for other brokers, which
        simulations may use. Otherwise those are unset.
        """
        if self.is_published:
            return {}
        return {
            **dict.fromkeys(CREDENTIALS, ""),
            "SWARMWRIGHT_USERNAME": self.username,
            "SWARMWRIGHT_PASSWORD": self.password,
        }


def new_account() -> Account:
    """Return an account with a random name and a random password."""
    return Account(f"user-{secrets.token_hex(8)}", secrets.token_urlsafe(_PASSWORD_BYTES))


def start_private(stack: ExitStack, port: int = 0) -> tuple[str, Account]:
    """Start a broker on loopback that ends with the stack; only programs of this user are admitted.

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
    account = new_account()
    allow_more_open_files()
    with engine_errors():
        broker = _engine.Broker(port=port, accounts=[(account.username, account.password)])
    stack.callback(broker.stop)
    _, problem = broker.publish(account.username, account.password)
    return broker.url, replace(account, is_published=problem is None)

//! The configuration of the broker.

use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

/// Configuration of the broker: addresses, accepted clients, and limits.
#[derive(Clone, Debug)]
pub struct Config {
    /// Address or name of this machine on which to listen; loopback by default.
    pub host: String,
    /// TCP port; 0 for any free one, `None` for no MQTT over TCP.
    pub port: Option<u16>,
    /// Path of a Unix socket on which to listen without TLS. A stale file of an earlier broker is replaced.
    pub socket: Option<PathBuf>,
    /// Permissions of the socket's file; users who may write to it may connect.
    pub socket_mode: u32,
    /// Port for MQTT over WebSocket; 0 for any free one, `None` for no WebSocket.
    pub websocket_port: Option<u16>,
    /// Password file with lines `user:hash`; `None` lets every client connect, unless there are `accounts`.
    pub users: Option<PathBuf>,
    /// Accounts with random passwords, instead of a password file. Only their clients may connect, except through the
    /// Unix socket, which is protected by the permissions of its file.
    pub accounts: Vec<Account>,
    /// Access file in Mosquitto's format; `None` lets every client read and write everything.
    pub access: Option<PathBuf>,
    /// Origins of web pages that may connect by WebSocket, such as `https://dashboard.example.org`, or `*` for all.
    /// Pages from the host to which they connect are always allowed, and so are clients other than browsers, which send
    /// no origin.
    pub origins: Vec<String>,
    /// Certificate chain (PEM). If set, both TCP ports accept TLS only.
    pub certificate: Option<PathBuf>,
    /// Private key of the certificate (PEM).
    pub key: Option<PathBuf>,
    /// Certificate authorities (PEM). If set, the TCP ports accept only clients with a certificate signed by one of
    /// them.
    pub client_ca: Option<PathBuf>,
    /// Limits on stored data.
    pub limits: Limits,
}

/// An account whose password the clients get from the program that starts both them and the broker.
#[derive(Clone)]
pub struct Account {
    /// User name.
    pub user: String,
    /// Password with at least 128 random bits. Checks are fast and not limited in number, since it cannot be guessed.
    pub password: String,
}

impl fmt::Debug for Account {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Account({:?}, ...)", self.user)
    }
}

/// Limits on the data that clients can make the broker store.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Size in bytes of the largest accepted packet.
    pub packet: usize,
    /// Bytes in transit to one client. From half of it on, publishers to an active reader are slowed down; a client
    /// that reads nothing is disconnected when it is this far behind.
    pub backlog: usize,
    /// Total size in bytes of all retained messages.
    pub retained: usize,
    /// Longest time that a session outlives its connection.
    pub session: Duration,
    /// Total size in bytes of everything stored for clients: messages in transit, incomplete packets, sessions, and
    /// retained messages. The default is a quarter of the memory of the machine (or of the control group if that has
    /// less), but at least 256 MiB.
    pub memory: usize,
    /// Largest number of connected clients.
    pub clients: usize,
    /// Packets per second accepted from one client; beyond that, reading from it is delayed. One second's worth may
    /// come in a burst.
    pub rate: u32,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            host: "127.0.0.1".into(),
            port: Some(0),
            socket: None,
            socket_mode: 0o600,
            websocket_port: None,
            users: None,
            accounts: Vec::new(),
            access: None,
            origins: Vec::new(),
            certificate: None,
            key: None,
            client_ca: None,
            limits: Limits::default(),
        }
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            // The largest message of the protocol with its topic and properties, as accepted by tools and servers.
            packet: (64 << 20) + (1 << 20),
            backlog: 128 << 20,
            retained: 64 << 20,
            session: Duration::from_secs(3600),
            memory: default_memory(),
            clients: 4096,
            // More than twice the rate of the fastest client in a run (docs/explanation/performance.md).
            rate: 500_000,
        }
    }
}

/// Returns a quarter of the memory, but at least 256 MiB; 1 GiB if the size of the memory is unknown.
fn default_memory() -> usize {
    let number =
        |path: &str| -> Option<usize> { std::fs::read_to_string(path).ok()?.trim().parse().ok() };
    let machine = std::fs::read_to_string("/proc/meminfo")
        .ok()
        .and_then(|text| {
            let line = text
                .lines()
                .find_map(|line| line.strip_prefix("MemTotal:"))?;
            let kibibytes: usize = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
            Some(kibibytes << 10)
        });
    let group = number("/sys/fs/cgroup/memory.max")
        .or_else(|| number("/sys/fs/cgroup/memory/memory.limit_in_bytes"));
    let all = [machine, group].into_iter().flatten().min();
    all.map_or(1 << 30, |bytes| (bytes / 4).max(256 << 20))
}

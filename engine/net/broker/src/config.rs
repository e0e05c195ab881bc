//! The configuration of the broker.

use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

/// Where the broker listens, which clients it accepts, and how much it stores.
#[derive(Clone, Debug)]
pub struct Config {
    /// Address or name of this machine to listen on; loopback by default.
    pub host: String,
    /// TCP port; 0 = any free one, None = no MQTT over TCP.
    pub port: Option<u16>,
    /// Path of a Unix socket to listen on, without TLS. A file that a broker left behind there is replaced.
    pub socket: Option<PathBuf>,
    /// Permissions of its file; users who may write to it may connect.
    pub socket_mode: u32,
    /// Port for MQTT over WebSocket; 0 = any free one, None = no WebSocket.
    pub websocket_port: Option<u16>,
    /// Password file, `user:hash` lines; None = every client may connect, unless there are `accounts`.
    pub users: Option<PathBuf>,
    /// Accounts with random passwords, instead of a password file: only their clients may connect, except at the Unix
    /// socket, which is guarded by the permissions of its file.
    pub accounts: Vec<Account>,
    /// Access file in Mosquitto's format; None = every client may read and write everything.
    pub access: Option<PathBuf>,
    /// Origins of web pages that may connect by WebSocket, as `https://dashboard.example.org`, or `*` for all. Pages from the
    /// host that they connect to always may, and clients other than browsers, which send no origin.
    pub origins: Vec<String>,
    /// Certificate chain, PEM. With it both TCP ports speak TLS only.
    pub certificate: Option<PathBuf>,
    /// Private key of the certificate, PEM.
    pub key: Option<PathBuf>,
    /// Authorities, PEM. With them only clients that have a certificate signed by one of them may connect to the TCP ports.
    pub client_ca: Option<PathBuf>,
    /// Limits on what is stored.
    pub limits: Limits,
}

/// An account of a broker whose clients get its password from the program that starts both.
#[derive(Clone)]
pub struct Account {
    /// User name.
    pub user: String,
    /// At least 128 random bits; checks are immediate and not limited in number, since it cannot be guessed.
    pub password: String,
}

impl fmt::Debug for Account {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "Account({:?}, ...)", self.user)
    }
}

/// Limits on what clients can make the broker store.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Largest packet accepted, bytes.
    pub packet: usize,
    /// Bytes in transit to one client. From half of it on, publishers to an active reader are slowed down;
    /// a client that reads nothing meanwhile is disconnected when it is this far behind.
    pub backlog: usize,
    /// All retained messages together, bytes.
    pub retained: usize,
    /// The longest that a session outlives its connection.
    pub session: Duration,
    /// Everything that is stored for all clients together, bytes: messages in transit, incomplete packets,
    /// sessions, retained messages. By default a quarter of the machine's memory (of the control group's, where that has less),
    /// but 256 MiB at least.
    pub memory: usize,
    /// Clients connected at a time.
    pub clients: usize,
    /// Packets accepted from one client per second; a client that sends more is read later. One second's worth is accepted at
    /// once.
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
            // The protocol's largest message, its topic and properties, as tools and servers accept.
            packet: (64 << 20) + (1 << 20),
            backlog: 128 << 20,
            retained: 64 << 20,
            session: Duration::from_secs(3600),
            memory: default_memory(),
            clients: 4096,
            // More than twice what the fastest client sends in a run (docs/explanation/performance.md).
            rate: 500_000,
        }
    }
}

/// A quarter of the memory, 256 MiB at least; 1 GiB where its size is not known.
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

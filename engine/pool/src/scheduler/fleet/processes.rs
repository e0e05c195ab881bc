//! Servers whose processes are the tool's own, and the processes that have ended.

use std::collections::{BTreeMap, BTreeSet};

/// Servers whose processes are watched, and of each the last process that ended.
#[derive(Debug, Default)]
pub(crate) struct Processes {
    watched: BTreeSet<u64>,
    ended: BTreeMap<u64, u64>,
}

impl Processes {
    pub fn watch(&mut self, servers: impl IntoIterator<Item = u64>) {
        self.watched.extend(servers);
    }

    /// Whether a server's process is watched.
    pub fn are_watched(&self, server: u64) -> bool {
        self.watched.contains(&server)
    }

    /// A server's process has ended.
    pub fn ended(&mut self, server: u64, pid: u64) {
        self.ended.insert(server, pid);
    }

    /// Whether a process is one that has ended.
    pub fn has_ended(&self, server: u64, pid: Option<u64>) -> bool {
        pid.is_some() && self.ended.get(&server).copied() == pid
    }
}

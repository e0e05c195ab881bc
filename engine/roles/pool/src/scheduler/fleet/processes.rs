//! Servers whose processes are the tool's own, and the processes that have ended.

use std::collections::{BTreeMap, BTreeSet};

/// What a process was computing when it ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct At {
    /// The request's number.
    pub request: u64,
    /// The first of the candidates that were computed, as an index in the request.
    pub first: usize,
    /// How many of them.
    pub candidates: usize,
    /// The request's episode, from 0; all of them where several are computed at once.
    pub episode: Option<usize>,
}

/// The end of a server's process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ending {
    /// The server's id.
    pub server: u64,
    /// The process that ended.
    pub pid: u64,
    /// How it ended, for people; the same text for the same cause.
    pub reason: String,
    /// Where in its code, or what it said last, if that is known.
    pub stack: Option<String>,
    /// It was ended from outside: what it computed is not to blame before that happens again and again.
    pub outside: bool,
    /// What it computed, if that is known.
    pub at: Option<At>,
}

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

//! Servers that may still be running an episode of this tool although its connection broke.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// How long after the first notification a server is told again that an episode is over; by then it has given the
/// episode up itself because no actuators came.
const MAX_TELLING: Duration = Duration::from_secs(120);
/// Shortest time between two notifications. They are repeated because one may be lost while the server's own connection
/// is down, or when this tool's breaks again.
const MIN_PAUSE: Duration = Duration::from_secs(1);
/// Largest number of episodes per server that are ended; the latest ones are kept.
const MAX_HASHES: usize = 8;

#[derive(Debug, Default)]
struct AbandonedServer {
    /// Episodes that the server may be running, the latest last; empty if it runs something else, or only waits.
    hashes: Vec<String>,
    /// Time of the first and the last notification.
    told: Option<(Instant, Instant)>,
}

/// Servers left behind, until they answer a discovery: a server that is running an episode answers none.
#[derive(Debug, Default)]
pub(crate) struct LeftBehind {
    servers: BTreeMap<u64, AbandonedServer>,
}

impl LeftBehind {
    /// Adds a server that may still be running the episode with this hash, or something else.
    pub fn add(&mut self, server: u64, hash: Option<String>) {
        let abandoned = self.servers.entry(server).or_default();
        let Some(hash) = hash else { return };
        abandoned.hashes.retain(|other| *other != hash);
        abandoned.hashes.push(hash);
        if abandoned.hashes.len() > MAX_HASHES {
            abandoned.hashes.remove(0);
        }
    }

    /// Removes a server that is not running an episode of this tool.
    pub fn remove(&mut self, server: u64) {
        self.servers.remove(&server);
    }

    /// Returns the servers to notify now that their episodes are over, each with an episode, or `None`. `all`: include
    /// servers that were notified a moment ago.
    pub fn due(&mut self, all: bool, now: Instant) -> Vec<(u64, Option<String>)> {
        let age = |then: Instant| now.saturating_duration_since(then);
        self.servers.retain(|_, abandoned| {
            abandoned
                .told
                .is_none_or(|(first, _)| age(first) < MAX_TELLING)
        });
        let mut due = Vec::new();
        for (server, abandoned) in &mut self.servers {
            if !all
                && abandoned
                    .told
                    .is_some_and(|(_, last)| age(last) < MIN_PAUSE)
            {
                continue;
            }
            let (first, _) = abandoned.told.unwrap_or((now, now));
            abandoned.told = Some((first, now));
            if abandoned.hashes.is_empty() {
                due.push((*server, None));
            }
            let hashes = abandoned.hashes.iter().cloned();
            due.extend(hashes.map(|hash| (*server, Some(hash))));
        }
        due
    }
}

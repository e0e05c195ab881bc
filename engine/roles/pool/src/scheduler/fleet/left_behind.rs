//! Servers that may still be at an episode of this tool since its connection broke.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// How long after it was told first a server is told again that an episode is over: by then it has given that up itself,
/// as no actuators came.
const MAX_TELLING: Duration = Duration::from_secs(120);
/// At least so much later it is told again: what it is told may be lost, as its own connection is not back yet, or this
/// tool's breaks again.
const MIN_PAUSE: Duration = Duration::from_secs(1);
/// Episodes of a server that are ended, at most, the last ones.
const MAX_HASHES: usize = 8;

#[derive(Debug, Default)]
struct AbandonedServer {
    /// Episodes that it may be computing, the last one at the end; empty if it computes something else, or only waits.
    hashes: Vec<String>,
    /// When it was told first and last.
    told: Option<(Instant, Instant)>,
}

/// These servers, until they answer a discovery: one that is at an episode answers none.
#[derive(Debug, Default)]
pub(crate) struct LeftBehind {
    servers: BTreeMap<u64, AbandonedServer>,
}

impl LeftBehind {
    /// A server may still be at this episode, or at something else.
    pub fn add(&mut self, server: u64, hash: Option<String>) {
        let abandoned = self.servers.entry(server).or_default();
        let Some(hash) = hash else { return };
        abandoned.hashes.retain(|other| *other != hash);
        abandoned.hashes.push(hash);
        if abandoned.hashes.len() > MAX_HASHES {
            abandoned.hashes.remove(0);
        }
    }

    /// A server is not at an episode of this tool.
    pub fn remove(&mut self, server: u64) {
        self.servers.remove(&server);
    }

    /// The servers that are to be told now that their episodes are over, each with an episode, or none. `all`: also those
    /// that were told a moment ago.
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

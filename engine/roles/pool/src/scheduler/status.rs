//! State of the scheduler, for users and monitors.

use std::time::{Duration, Instant};

use swarmwright_protocol::{Activity, AnnouncedSide, MOST_LISTED, NoServer, Status, Used, Waiting};

use crate::scheduler::Scheduler;
use crate::scheduler::fleet::slot::Slot;

/// Duration of silence from which it is reported.
const SILENCE: Duration = Duration::from_secs(1);

/// Largest number of characters of a reason in a status.
const LONGEST: usize = 200;

/// Sizes of a scheduler's collections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Holdings {
    /// Number of evaluations that wait for a server.
    pub queued: usize,
    /// Number of stepwise episodes in flight.
    pub episodes: usize,
    /// Number of blocks and batches in flight.
    pub requests: usize,
    /// Number of rounds of discovery whose answers are accepted.
    pub rounds: usize,
    /// Number of servers that may be used.
    pub servers: usize,
    /// Number of warnings that are not issued again.
    pub warned_once: usize,
}

impl Scheduler {
    /// Returns the numbers of sensors and actuators, as given in the experiment or announced by a fitting server.
    #[must_use]
    pub fn sizes(&self) -> Option<(usize, usize)> {
        self.view().sizes()
    }

    /// Returns the number that is unknown although the other one is known: `sensors` or `actuators`.
    #[must_use]
    pub fn unknown_size(&self) -> Option<&'static str> {
        match self.view().known_sizes() {
            (None, Some(_)) => Some("sensors"),
            (Some(_), None) => Some("actuators"),
            _ => None,
        }
    }

    /// Returns whether a fitting server is online for this tool.
    #[must_use]
    pub fn has_server(&self) -> bool {
        !self.fleet.is_empty()
    }

    /// Returns a note if a fitting server serves another tool.
    #[must_use]
    pub fn busy_elsewhere(&self) -> Option<String> {
        self.fleet.busy_elsewhere(&self.config.demand)
    }

    /// Returns why the work cannot be done, if all servers refuse it.
    #[must_use]
    pub fn rejected(&self, now: Instant) -> Option<String> {
        let alone = self.outlook.is_refused(now) && self.busy_elsewhere().is_none();
        alone.then(|| self.fleet.refused()).flatten()
    }

    /// Describes the required and the found servers.
    #[must_use]
    pub fn describe(&self) -> String {
        format!(
            "required: {}; found: {}",
            self.config.demand.describe(),
            self.found()
        )
    }

    /// Returns whether no server has been found, not even one that does not fit.
    #[must_use]
    pub fn found_nothing(&self) -> bool {
        self.found_servers().is_none()
    }

    fn found(&self) -> String {
        let servers = self.found_servers();
        servers.unwrap_or_else(|| "no server answered".to_owned())
    }

    fn found_servers(&self) -> Option<String> {
        self.fleet
            .describe(&self.config.demand, &self.config.timeouts)
    }

    /// Returns the titles that the servers offer.
    #[must_use]
    pub fn titles(&self) -> Vec<String> {
        self.fleet.titles()
    }

    /// Returns the metrics that servers with this simulation announce, including servers that do not fit.
    #[must_use]
    pub fn metrics(&self) -> Vec<String> {
        self.fleet.metrics()
    }

    /// Returns the sides of a match that each server with this simulation announces, including servers that do not fit.
    #[must_use]
    pub fn sides(&self) -> Vec<(u64, &[AnnouncedSide])> {
        self.fleet.sides()
    }

    /// Returns the determinism and the tolerance that each server declares.
    #[must_use]
    pub fn determinism(&self) -> Vec<(u64, Option<&str>, Option<f64>)> {
        self.fleet.declared()
    }

    /// Returns how long there has been work but no server for it.
    #[must_use]
    pub fn unserved(&self, now: Instant) -> Duration {
        self.outlook.unserved_for(now)
    }

    /// Returns all work in flight, the longest silent first. For an overtaken server, the first unanswered work that
    /// others have finished is returned instead of its current work.
    #[must_use]
    pub fn waiting(&self, now: Instant) -> Vec<Waiting> {
        let mut all = self.in_flight.waiting(now);
        let overtaken = self.fleet.overtaken(now);
        if overtaken.is_empty() {
            return all;
        }
        all.retain(|entry| overtaken.iter().all(|other| other.server != entry.server));
        all.extend(overtaken);
        all.sort_by(|left, right| right.silent.total_cmp(&left.silent));
        all
    }

    /// Describes the message that has been awaited for longest; empty if there is no delay.
    #[must_use]
    pub fn waiting_for(&self, now: Instant) -> String {
        if self.finished() {
            return String::new();
        }
        match self.waiting(now).first() {
            Some(oldest) if oldest.silent >= SILENCE.as_secs_f64() * self.slowdown => {
                oldest.to_string()
            }
            Some(_) => String::new(),
            None => match self.no_server(now) {
                Some(NoServer {
                    seconds,
                    found: servers,
                }) => {
                    format!("waiting for a server for {seconds:.1} s ({servers})")
                }
                None => String::new(),
            },
        }
    }

    fn no_server(&self, now: Instant) -> Option<NoServer> {
        let unserved = self.unserved(now);
        (unserved >= SILENCE).then(|| NoServer {
            seconds: unserved.as_secs_f64(),
            found: self
                .found_servers()
                .unwrap_or_else(|| "none is connected".to_owned()),
        })
    }

    /// Returns the status for monitors.
    #[must_use]
    pub fn status(&self, now: Instant) -> Status {
        let count = |number: usize| number as u64;
        let used = |(id, slot): (u64, &Slot)| {
            let past = self.fleet.health().failures(id);
            Used {
                server: id,
                mode: slot.way.name().to_owned(),
                speed: slot.rate.map(rounded),
                failures: past.map_or(0, |(failures, _)| failures.into()),
                reason: past.map(|(_, reason)| shortened(reason)),
                // A new server also has a pause, although it has not failed.
                benched: slot
                    .backs_off_until
                    .filter(|_| past.is_some())
                    .map(|until| rounded(until.saturating_duration_since(now).as_secs_f64())),
            }
        };
        let mut servers: Vec<Used> = self.fleet.slots().map(used).collect();
        servers.sort_by_key(|used| (used.benched.is_none(), used.server));
        servers.truncate(MOST_LISTED);
        let mut waiting_for = self.waiting(now);
        waiting_for.truncate(MOST_LISTED);
        for waiting in &mut waiting_for {
            waiting.silent = rounded(waiting.silent);
        }
        let mut status = Status::new(
            self.config.tool.clone(),
            self.config.demand.simulation.clone(),
        );
        if self.ledger.work().is_some() {
            status.state = Activity::Evaluating;
        }
        (status.done, status.total) = (count(self.done()), count(self.total()));
        (status.waiting_for, status.servers) = (waiting_for, servers);
        status.no_server = self.no_server(now).map(|alone| NoServer {
            seconds: rounded(alone.seconds),
            found: shortened(&alone.found),
        });
        status
    }

    /// Returns the sizes of the scheduler's collections.
    #[must_use]
    pub fn holdings(&self) -> Holdings {
        let (episodes, requests) = self.in_flight.len();
        Holdings {
            queued: self.ledger.queued(),
            episodes,
            requests,
            rounds: self.discovery.understood(),
            servers: self.fleet.len(),
            warned_once: self.outbox.warned_once(),
        }
    }

    /// Returns whether a server has no job of this tool.
    #[must_use]
    pub fn has_nothing_on(&self, server: u64) -> bool {
        let slot = self.fleet.slot(server);
        slot.is_none_or(|slot| slot.jobs.is_empty())
    }

    /// Returns whether a server is idle although there is work for it: it does not back off, and the queued work need
    /// not wait for another server. Returns true for an unknown server.
    #[must_use]
    pub fn is_idle(&self, server: u64) -> bool {
        self.fleet.slot(server).is_none_or(|slot| {
            let servers: Vec<u64> = self.fleet.usable().map(|(id, _)| id).collect();
            slot.jobs.is_empty() && slot.usable() && self.ledger.has_for(server, &servers)
        })
    }
}

/// Rounds to thousandths, that is, milliseconds.
fn rounded(number: f64) -> f64 {
    (number * 1e3).round() / 1e3
}

/// Shortens a text, so that a thousand of them fit in a message.
fn shortened(text: &str) -> String {
    if text.chars().count() <= LONGEST {
        return text.to_owned();
    }
    text.chars().take(LONGEST - 2).chain(" …".chars()).collect()
}

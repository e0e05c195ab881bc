//! Speculative execution: backup copies of work that is held by slow or silent servers. The first result counts.
//!
//! A server that is silent for much longer than ever before is a straggler long before its time-out, and its work is
//! given to another server as well (hedged requests: Dean and Barroso, The Tail at Scale, 2013). When the queue is
//! empty, idle servers get copies of work that others would need much longer for.

use std::time::{Duration, Instant};

use crate::mode::Way;
use crate::scheduler::fleet::capacity::number;
use crate::scheduler::fleet::slot::LATENESS_FACTOR;
use crate::scheduler::job::Job;
use crate::scheduler::modes::episode::Episode;
use crate::scheduler::modes::request::Request;
use crate::scheduler::queue::piece::{Piece, Purpose};
use crate::scheduler::queue::results::rectangle;
use crate::scheduler::view::View;

/// Largest expected duration of a copy, as a share of the remaining time of the original.
const MAX_SHARE_OF_REMAINING: f64 = 0.5;
/// Seconds that a copy must be expected to save.
const MIN_SAVED_SECONDS: f64 = 0.25;

impl View<'_> {
    /// Returns when the next server becomes a straggler.
    pub fn next_straggler(&self) -> Option<Instant> {
        let runs = self
            .in_flight
            .episodes()
            .filter_map(|run| self.episode_bound(run));
        let requests = self.in_flight.requests();
        let requests = requests.filter_map(|request| self.request_bound(request));
        runs.chain(requests).min()
    }

    /// Returns the servers that have been silent for suspiciously long.
    pub fn stragglers(&self, now: Instant) -> Vec<u64> {
        let late = |doubt: Option<Instant>| doubt.is_some_and(|at| at <= now);
        let mut servers = Vec::new();
        for run in self.in_flight.episodes() {
            if late(self.episode_bound(run)) {
                servers.push(run.server);
            }
        }
        for request in self.in_flight.requests() {
            if late(self.request_bound(request)) {
                servers.push(request.server);
            }
        }
        servers.sort_unstable();
        servers.dedup();
        servers
    }

    /// Returns the shortest silence that is suspicious; it is longer on a busy machine, where the server may not have
    /// been scheduled.
    fn least(&self) -> Duration {
        let timeouts = &self.config.timeouts;
        let least = timeouts.least.mul_f64(self.slowdown);
        least.min(timeouts.step.max(timeouts.least))
    }

    fn episode_bound(&self, run: &Episode) -> Option<Instant> {
        let slot = self.fleet.slot(run.server)?;
        let least = self.least();
        let step = slot.steps.bound(least).map(|bound| run.heard() + bound);
        let episode = slot.episodes.bound(least).map(|bound| run.started + bound);
        let first = step.into_iter().chain(episode).min();
        first.filter(|_| !run.has_backup() && self.may_copy(&run.piece))
    }

    fn request_bound(&self, request: &Request) -> Option<Instant> {
        let slot = self.fleet.slot(request.server)?;
        let least = self.least();
        let bound = match &request.batch {
            Some(batch) if batch.steers() => slot.steps.bound(least)?,
            _ => {
                let doubtful = slot.doubtful_after(request.piece.len())?;
                Duration::try_from_secs_f64(doubtful).ok()?.max(least)
            }
        };
        let allowed = !request.has_backup() && self.may_copy(&request.piece);
        allowed.then_some(request.heard() + bound)
    }

    /// Returns since when a server has been silent about its current job, if the job takes much longer than expected.
    pub fn ignored_since(&self, server: u64, job: &Job, now: Instant) -> Option<Instant> {
        let slot = self.fleet.slot(server)?;
        let (piece, since) = self.in_flight.piece_of(job)?;
        let expected = slot.rate.map_or(0.0, |rate| number(piece.len()) / rate);
        let elapsed = now.saturating_duration_since(since).as_secs_f64();
        let is_at_it = slot.jobs.first() == Some(job) && slot.answered_at <= since;
        (is_at_it && elapsed > LATENESS_FACTOR * expected).then_some(since)
    }

    pub fn may_copy(&self, piece: &Piece) -> bool {
        // Work with which servers were lost must stay alone, or its effect cannot be observed.
        let suspect = self.ledger.attribution().is_suspect(piece.first());
        self.config.faults.backup
            && !self.config.visual
            && piece.purpose == Purpose::Work
            && !suspect
    }

    pub fn is_shared(&self, piece: &Piece) -> bool {
        let mut evaluations = piece.evaluations.clone();
        evaluations.any(|evaluation| self.ledger.is_shared(evaluation))
    }

    /// Returns the idle servers with their speeds, the fastest first.
    pub fn idle(&self) -> Vec<(f64, u64)> {
        let idle = self.fleet.usable().filter(|(_, slot)| slot.jobs.is_empty());
        let mut idle: Vec<(f64, u64)> = idle
            .filter_map(|(id, slot)| Some((slot.rate?, id)))
            .collect();
        idle.sort_by(|left, right| right.0.total_cmp(&left.0).then(left.1.cmp(&right.1)));
        idle
    }

    /// Returns the work in flight that may be copied, the longest remaining time first.
    pub fn under_way(&self, now: Instant) -> Vec<UnderWay> {
        let mut all = Vec::new();
        for (id, slot) in self.fleet.slots() {
            let mut before = 0.0;
            for job in &slot.jobs {
                let Some((piece, since)) = self.in_flight.piece_of(job) else {
                    continue;
                };
                let elapsed = now.saturating_duration_since(since).as_secs_f64();
                let expected = slot.rate.map_or(0.0, |rate| number(piece.len()) / rate);
                before += expected;
                if !self.may_copy(piece) || self.is_shared(piece) {
                    continue;
                }
                // Some episodes of a batch may have ended.
                let Some(open) = self.ledger.first_open(&piece.evaluations) else {
                    continue;
                };
                let doubtful = slot.doubtful_after(piece.len()).unwrap_or_default();
                // Work that has taken much longer than ever before may take as long again.
                let remaining = if before > elapsed {
                    before - elapsed
                } else if elapsed > doubtful {
                    elapsed
                } else {
                    0.0
                };
                all.push(UnderWay {
                    server: id,
                    open: piece.part(open),
                    remaining,
                });
            }
        }
        all.sort_by(|left, right| right.remaining.total_cmp(&left.remaining));
        all
    }

    /// Returns the work with the longest remaining time that this server could do in much less time.
    pub fn slowest(&self, server: u64, rate: f64, under_way: &[UnderWay]) -> Option<Piece> {
        let limit = match self.fleet.slot(server)?.way {
            Way::Stepwise => 1,
            Way::Batched(batch) => batch,
            Way::Offloaded => usize::MAX,
        };
        let is_worth = |own: f64, remaining: f64| {
            let saved = MIN_SAVED_SECONDS * self.slowdown;
            remaining * MAX_SHARE_OF_REMAINING >= own && remaining >= own + saved
        };
        let longest = under_way.iter();
        // Stop at the first work for which copying even one evaluation is not worthwhile.
        let mut longest = longest.take_while(|other| is_worth(1.0 / rate, other.remaining));
        longest.find_map(|other| {
            let open = &other.open.evaluations;
            let count = rectangle(open, self.ledger.episodes(), limit);
            let part = open.start..open.start + count;
            is_worth(number(count) / rate, other.remaining)
                .then(|| other.open.part(part).backup(other.server))
        })
    }
}

/// Work that only one server has.
pub(crate) struct UnderWay {
    server: u64,
    /// Its unfinished evaluations.
    pub open: Piece,
    /// Expected remaining seconds.
    remaining: f64,
}

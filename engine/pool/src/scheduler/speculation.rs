//! Work that two servers have: copies of what a slow or silent server is at. The first result counts.
//!
//! A server that says nothing for much longer than it ever did is doubted long before its time-out: its work is given to
//! another one as well (hedged requests: Dean and Barroso, The Tail at Scale, 2013). When nothing is queued any more,
//! idle servers get copies of what others would take much longer for.

use std::time::{Duration, Instant};

use crate::mode::Way;
use crate::scheduler::Scheduler;
use crate::scheduler::dispatch::number;
use crate::scheduler::modes::episode::Episode;
use crate::scheduler::modes::in_flight::Dropped;
use crate::scheduler::modes::request::Request;
use crate::scheduler::queue::ledger::rectangle;
use crate::scheduler::queue::piece::{Piece, Purpose};
use crate::scheduler::retry::Blame;

/// A copy must be expected to be done in this part of the time that the other one still takes.
const WORTH: f64 = 0.5;
/// Seconds that a copy must be expected to save.
const SAVED: f64 = 0.25;
/// How often it is looked whether one has become worth while.
const LOOK: Duration = Duration::from_millis(20);
/// A block may take this many times as long as expected before its server is doubted.
const ROOM: f64 = 4.0;
/// What a server found in one evaluation.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Found {
    pub server: u64,
    pub fitness: f64,
    pub metrics: Vec<f64>,
}

impl Found {
    pub fn new(server: u64, fitness: f64, metrics: Vec<f64>) -> Self {
        Self {
            server,
            fitness,
            metrics,
        }
    }
}

impl Scheduler {
    /// A result came. It counts, unless the evaluation has one, or is first to be compared with another server's.
    pub(crate) fn settle(&mut self, piece: &Piece, evaluation: usize, found: Found, now: Instant) {
        self.vouch(found.server);
        if piece.purpose == Purpose::Probe {
            return;
        }
        if piece.purpose == Purpose::Audit || self.checks.contains_key(&evaluation) {
            return self.audited(evaluation, found, now);
        }
        if self.ledger.has_ended(evaluation) {
            self.counts.double += 1;
            return;
        }
        if self.is_to_be_audited(evaluation, found.server) {
            return self.audit(evaluation, found);
        }
        self.count(evaluation, &found, now);
    }

    /// A result counts: copies of its evaluation are not needed any more.
    pub(crate) fn count(&mut self, evaluation: usize, found: &Found, now: Instant) {
        let shared = self.ledger.is_shared(evaluation);
        self.ledger
            .settle(evaluation, found.server, found.fitness, &found.metrics);
        if shared {
            let reason = format!("server {} was faster", found.server);
            self.drop_copies(evaluation, &reason, now);
        }
    }

    /// Ends what is under way for an evaluation that has ended, where nothing else depends on it.
    pub(crate) fn drop_copies(&mut self, evaluation: usize, reason: &str, now: Instant) {
        self.drop_all(
            |scheduler, piece| scheduler.is_over(piece, evaluation),
            reason,
            now,
        );
    }

    /// Whether nothing of a piece is waited for any more, since this evaluation has ended.
    fn is_over(&self, piece: &Piece, evaluation: usize) -> bool {
        !matches!(piece.purpose, Purpose::Audit | Purpose::Probe)
            && piece.evaluations.contains(&evaluation)
            && piece
                .evaluations
                .clone()
                .all(|one| self.ledger.has_ended(one))
    }

    /// Ends the probes that are under way: there is nothing more to tell, nor to record.
    pub(crate) fn drop_probes(&mut self, now: Instant) {
        let reason = "all work is done";
        self.drop_all(|_, piece| piece.purpose == Purpose::Probe, reason, now);
    }

    fn drop_all(&mut self, over: impl Fn(&Self, &Piece) -> bool, reason: &str, now: Instant) {
        for (server, job) in self.in_flight.jobs_of(|piece| over(self, piece)) {
            self.fleet.finished(server, &job);
            match self.in_flight.drop_job(job) {
                Some(Dropped::Episode(hash, episode)) => {
                    if episode.piece.purpose != Purpose::Probe {
                        self.record_run(&episode, Some(reason.to_owned()), None, now);
                    }
                    self.end_run(server, &hash);
                }
                Some(Dropped::Request(number, request)) => {
                    if request.piece.purpose != Purpose::Probe {
                        self.record_request(&request, Some(reason.to_owned()), now);
                    }
                    if let Some(batch) = &request.batch {
                        // On its own topic: what is said of control, all servers hear.
                        let step = batch.steps().saturating_sub(1);
                        self.end_batch(server, number, step);
                        continue;
                    }
                    // There is no way to end one of two requests.
                    let others = self.fleet.take_jobs(server);
                    self.let_go(server);
                    self.fail_each(others, reason, Blame::Nobody, now);
                }
                None => {}
            }
        }
    }

    /// When the next one of those under way takes longer than it should.
    pub(crate) fn next_doubt(&self) -> Option<Instant> {
        let runs = self
            .in_flight
            .episodes()
            .filter_map(|run| self.run_doubt(run));
        let requests = self.in_flight.requests();
        let requests = requests.filter_map(|request| self.request_doubt(request));
        runs.chain(requests).min()
    }

    fn run_doubt(&self, run: &Episode) -> Option<Instant> {
        let slot = self.fleet.slot(run.server)?;
        let least = self.config.faults.least;
        let step = slot.steps.bound(least).map(|bound| run.heard + bound);
        let episode = slot.episodes.bound(least).map(|bound| run.started + bound);
        let first = step.into_iter().chain(episode).min();
        first.filter(|_| !run.doubted && self.may_copy(&run.piece))
    }

    fn request_doubt(&self, request: &Request) -> Option<Instant> {
        let slot = self.fleet.slot(request.server)?;
        let least = self.config.faults.least;
        let bound = match &request.batch {
            Some(batch) if batch.steers() => slot.steps.bound(least)?,
            _ => {
                let expected = ROOM * number(request.piece.len()) / slot.rate?;
                Duration::try_from_secs_f64(expected).ok()?.max(least)
            }
        };
        let allowed = !request.doubted && self.may_copy(&request.piece);
        allowed.then_some(request.heard + bound)
    }

    fn may_copy(&self, piece: &Piece) -> bool {
        // What servers were lost with is to be alone: else nobody can tell what it does.
        let suspect = self.ledger.suspicions.is_suspect(piece.first());
        self.config.faults.backup
            && !self.config.visual
            && piece.purpose == Purpose::Work
            && !suspect
    }

    /// Gives the work of servers that have been silent for strangely long to others as well.
    pub(crate) fn doubt(&mut self, now: Instant) {
        let late = |doubt: Option<Instant>| doubt.is_some_and(|at| at <= now);
        let mut servers = Vec::new();
        for run in self.in_flight.episodes() {
            if late(self.run_doubt(run)) {
                servers.push(run.server);
            }
        }
        for request in self.in_flight.requests() {
            if late(self.request_doubt(request)) {
                servers.push(request.server);
            }
        }
        servers.sort_unstable();
        servers.dedup();
        for server in servers {
            self.doubt_server(server, now);
        }
    }

    fn doubt_server(&mut self, server: u64, now: Instant) {
        let mut pieces = Vec::new();
        let mut words = String::new();
        for run in self.in_flight.episodes_of(server) {
            run.doubted = true;
            words = run.waiting_for(now).to_string();
            pieces.push(run.piece.clone());
        }
        for request in self.in_flight.requests_of(server) {
            request.doubted = true;
            if words.is_empty() {
                words = request.waiting_for(now).to_string();
            }
            pieces.push(request.piece.clone());
        }
        self.fleet.fell_silent(server);
        let mut given = false;
        pieces.sort_by_key(Piece::first);
        for piece in pieces.into_iter().rev() {
            if self.may_copy(&piece) && !self.is_shared(&piece) {
                // Of a batch some episodes may be over.
                let mut rest = piece.evaluations.clone();
                while let Some(open) = self.ledger.first_open(&rest) {
                    rest.start = open.end;
                    let copy = piece.part(open).backup(server);
                    self.ledger.hold(&copy);
                    self.ledger.queue(copy);
                    self.counts.backups += 1;
                    given = true;
                }
            }
        }
        if given {
            self.outbox.warn(format!(
                "{words}, much longer than ever before; the work goes to another server as well"
            ));
        }
    }

    fn is_shared(&self, piece: &Piece) -> bool {
        let mut evaluations = piece.evaluations.clone();
        evaluations.any(|evaluation| self.ledger.is_shared(evaluation))
    }

    /// Nothing is queued any more: idle servers get copies of what others would take much longer for.
    pub(crate) fn back_up(&mut self, now: Instant) {
        if !self.config.faults.backup || self.config.visual || self.ledger.queued() > 0 {
            return;
        }
        // Not after each of a thousand servers' messages.
        if self.look_at.is_some_and(|at| at > now) {
            return;
        }
        self.look_at = None;
        let idle = self.fleet.usable().filter(|(_, slot)| slot.jobs.is_empty());
        let mut idle: Vec<(f64, u64)> = idle
            .filter_map(|(id, slot)| Some((slot.rate?, id)))
            .collect();
        if idle.is_empty() {
            return;
        }
        idle.sort_by(|one, other| other.0.total_cmp(&one.0).then(one.1.cmp(&other.1)));
        let mut under_way = self.under_way(now);
        for (rate, server) in idle {
            if under_way.is_empty() {
                return;
            }
            let Some(copy) = self.slowest(server, rate, &under_way) else {
                self.look_at = Some(now + LOOK);
                continue;
            };
            self.ledger.hold(&copy);
            self.counts.backups += 1;
            self.start(copy, server, now);
            under_way.retain(|other| !self.is_shared(&other.open));
        }
    }

    /// What of all servers' work others may have as well, what takes longest first.
    fn under_way(&self, now: Instant) -> Vec<UnderWay> {
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
                // Of a batch some episodes may be over.
                let Some(open) = self.ledger.first_open(&piece.evaluations) else {
                    continue;
                };
                // What has taken longer than expected may take as long again.
                let remaining = if before > elapsed {
                    before - elapsed
                } else {
                    elapsed
                };
                all.push(UnderWay {
                    server: id,
                    open: piece.part(open),
                    remaining,
                });
            }
        }
        all.sort_by(|one, other| other.remaining.total_cmp(&one.remaining));
        all
    }

    /// What a server could do in much less time than it will still take where it is; the worst of these.
    fn slowest(&self, server: u64, rate: f64, under_way: &[UnderWay]) -> Option<Piece> {
        let limit = match self.fleet.slot(server)?.way {
            Way::Stepwise => 1,
            Way::Batched(batch) => batch,
            Way::Offloaded => usize::MAX,
        };
        let is_worth =
            |own: f64, remaining: f64| remaining * WORTH >= own && remaining >= own + SAVED;
        let longest = under_way.iter();
        // Where one evaluation is not worth it, none is in what is left.
        let mut longest = longest.take_while(|other| is_worth(1.0 / rate, other.remaining));
        longest.find_map(|other| {
            let open = &other.open.evaluations;
            let count = rectangle(open, self.ledger.episodes(), limit);
            let part = open.start..open.start + count;
            is_worth(number(count) / rate, other.remaining)
                .then(|| other.open.part(part).backup(other.server))
        })
    }

    /// A fitness for no episode under way.
    pub(crate) fn unwanted(&mut self, hash: &str) {
        match self.in_flight.ended(hash) {
            Some((_, true)) => self.counts.double += 1,
            Some(_) => self.counts.late += 1,
            None => {}
        }
    }
}

/// Work that a server has and nobody else.
struct UnderWay {
    server: u64,
    /// What of it is not over.
    open: Piece,
    /// Seconds that it will probably take.
    remaining: f64,
}

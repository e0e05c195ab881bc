//! Servers whose processes are the tool's own: who watches them knows when and how one ended, and what it was at; the pool
//! knows which one has not answered in time.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use swarmwright_mqtt::Waker;

use crate::journal::Attempt;
use crate::scheduler::Scheduler;
use crate::scheduler::job::Job;
use crate::scheduler::queue::piece::Piece;
use crate::scheduler::retry::Blame;

/// Requests that are remembered, for what comes late of them.
const PLACES: usize = 4096;

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
    /// Somebody else ended it: what it computed is not to blame before that happens again and again.
    pub outside: bool,
    /// What it computed, if that is known.
    pub at: Option<At>,
}

impl Ending {
    fn blame(&self) -> Blame {
        if self.outside {
            Blame::Gone
        } else {
            Blame::Crash
        }
    }
}

/// What the pool and whoever watches the processes tell each other, from any thread.
#[derive(Clone)]
pub struct Supervision {
    shared: Arc<Mutex<Shared>>,
    waker: Waker,
}

#[derive(Default)]
struct Shared {
    endings: Vec<Ending>,
    alive: Vec<u64>,
    overdue: Vec<u64>,
    starting: usize,
    /// By request.
    places: VecDeque<(u64, Place)>,
    generation: Option<u64>,
}

/// What a request is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Its first candidate.
    pub candidate: usize,
    /// Its first episode.
    pub episode: usize,
    /// The generation, if the pool was told.
    pub generation: Option<u64>,
}

impl Supervision {
    pub(crate) fn new(waker: Waker) -> Self {
        Self {
            shared: Arc::default(),
            waker,
        }
    }

    fn shared(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A process has ended. To be told before another one is started under its id.
    pub fn ended(&self, ending: Ending) {
        self.shared().endings.push(ending);
        self.waker.wake();
    }

    /// A server of which it was asked goes on computing.
    pub fn is_alive(&self, server: u64) {
        self.shared().alive.push(server);
        self.waker.wake();
    }

    /// So many servers are being started: as long as it is any, the pool does not give up for want of servers.
    pub fn starting(&self, servers: usize) {
        self.shared().starting = servers;
    }

    /// Servers that have not answered in time, since the last call. Each is to be looked at: it has ended, or it is alive.
    pub fn take_overdue(&self) -> Vec<u64> {
        std::mem::take(&mut self.shared().overdue)
    }

    /// What a request was about.
    #[must_use]
    pub fn place(&self, request: u64) -> Option<Place> {
        let shared = self.shared();
        let mut places = shared.places.iter().rev();
        places
            .find(|(number, _)| *number == request)
            .map(|(_, place)| *place)
    }

    pub(crate) fn are_starting(&self) -> bool {
        self.shared().starting > 0
    }

    pub(crate) fn is_overdue(&self, server: u64) {
        self.shared().overdue.push(server);
    }

    pub(crate) fn sent(&self, request: u64, candidate: usize, episode: usize) {
        let mut shared = self.shared();
        if shared.places.len() >= PLACES {
            shared.places.pop_front();
        }
        let generation = shared.generation;
        let place = Place {
            candidate,
            episode,
            generation,
        };
        shared.places.push_back((request, place));
    }

    pub(crate) fn set_generation(&self, generation: Option<u64>) {
        self.shared().generation = generation;
    }

    pub(crate) fn take(&self) -> (Vec<Ending>, Vec<u64>) {
        let mut shared = self.shared();
        (
            std::mem::take(&mut shared.endings),
            std::mem::take(&mut shared.alive),
        )
    }
}

impl Scheduler {
    /// The processes of these servers are watched: [`ended`](Self::ended) tells when one ends.
    pub fn watch(&mut self, servers: impl IntoIterator<Item = u64>) {
        self.processes.watch(servers);
    }

    /// The first candidate and the first episode of a request to a server that is watched.
    pub(crate) fn place(&self, request: u64) -> Option<(usize, usize)> {
        let request = self.in_flight.request(request)?;
        if !self.processes.are_watched(request.server) {
            return None;
        }
        let (candidates, episodes) = self.ledger.extent(&request.piece);
        Some((candidates.start, episodes.start))
    }

    /// A watched server goes on computing: it may take longer.
    pub fn is_alive(&mut self, server: u64, now: Instant) {
        for request in self.in_flight.requests_of(server) {
            request.heard = now;
            request.overdue = false;
        }
    }

    /// The process of a watched server has ended. What it computed is tried again, and held against it, if that is known;
    /// all else that it had goes to others as if nothing had happened.
    pub fn ended(&mut self, ending: &Ending, now: Instant) {
        let server = ending.server;
        self.processes.ended(server, ending.pid);
        self.counts.server_failures += 1;
        self.outbox
            .warn_counted(format!("{}; it is started again", ending.reason));
        let jobs = self.fleet.left(server);
        let blame = ending.blame();
        for (index, job) in jobs.into_iter().enumerate() {
            // What waited only is not to blame.
            let blame = if index == 0 { blame } else { Blame::Nobody };
            match job {
                Job::Request(number) => match ending.at.filter(|at| at.request == number) {
                    Some(at) => self.fail_at(number, at, ending, now),
                    None if self.is_block(number) => {
                        self.fail_request(number, &ending.reason, Blame::Nobody, now);
                    }
                    None => self.fail_request(number, &ending.reason, blame, now),
                },
                Job::Episode(hash) => self.fail_episode(&hash, &ending.reason, blame, now),
            }
        }
        self.dispatch(now);
    }

    fn is_block(&self, request: u64) -> bool {
        let request = self.in_flight.request(request);
        request.is_some_and(|request| request.batch.is_none())
    }

    /// A server's process ended at a part of a block.
    fn fail_at(&mut self, number: u64, at: At, ending: &Ending, now: Instant) {
        let Some(request) = self.in_flight.take_request(number) else {
            return;
        };
        let whole = request.piece.clone();
        let columns = self.ledger.extent(&whole).1.len();
        let offset = at.first * columns + at.episode.unwrap_or(0);
        let length = if at.episode.is_some() {
            1
        } else {
            at.candidates * columns
        };
        let start = (whole.first() + offset).min(whole.evaluations.end);
        let end = (start + length).min(whole.evaluations.end);
        let mut parts: Vec<Piece> = Vec::new();
        for rest in [whole.first()..start, end..whole.evaluations.end] {
            if !rest.is_empty() {
                parts.push(whole.part(rest));
            }
        }
        let reason = &ending.reason;
        if !parts.is_empty() {
            let words = format!("not finished: {reason}");
            self.record_request(&request, Some(words), now);
        }
        for part in parts.into_iter().rev() {
            self.retry(part, ending.server, reason, Blame::Nobody, now);
        }
        if start == end {
            return;
        }
        let culprit = whole.part(start..end);
        let attempt = Attempt {
            mode: crate::mode::Mode::Offloaded.name(),
            server: ending.server,
            error: Some(reason.clone()),
            stack: self.outbox.stack_once(reason, ending.stack.clone()),
            ..Attempt::default()
        };
        self.record(attempt, &culprit, request.started, now);
        self.retry(culprit, ending.server, reason, ending.blame(), now);
    }
}

//! What of the work is queued and what is done. Evaluations are numbered candidate by candidate, episode by episode.

use std::collections::{HashSet, VecDeque};
use std::ops::Range;

use crate::scheduler::queue::blame::Suspicions;
use crate::scheduler::queue::piece::{Piece, Purpose};
use crate::scheduler::queue::results::{Results, Settled, rectangle};
use crate::work::{Work, WorkError};

/// Fewer evaluations than these are not worth forgetting.
const WORTH: usize = 4096;

/// The books of one block of work.
#[derive(Debug, Default)]
pub(crate) struct Ledger {
    work: Option<Work>,
    queue: VecDeque<Piece>,
    queued: usize,
    results: Results,
    /// How many metrics each evaluation has.
    metrics: usize,
    settled: Vec<bool>,
    /// In how many places each evaluation waits or is under way.
    holders: Vec<u8>,
    /// Whose result each is.
    by: Vec<u64>,
    /// What is held against evaluations.
    suspicions: Suspicions,
    /// The last evaluation that has succeeded.
    good: Option<usize>,
    done: usize,
    /// Evaluations before this one are forgotten; they have ended. All lists of evaluations begin here.
    forgotten: usize,
    /// Candidates, counted from the first that is not forgotten: episodes that have not ended.
    open: Vec<usize>,
    /// Candidates that have ended since `take_settled`.
    fresh: Vec<usize>,
}

impl Ledger {
    pub fn new(work: Work, metrics: usize) -> Self {
        let count = work.len();
        let mut ledger = Self {
            work: Some(work),
            metrics,
            ..Self::default()
        };
        ledger.enqueue(0..count);
        ledger
    }

    /// Adds candidates behind the others; see [`Work::extend`].
    pub fn extend(&mut self, genomes: &[f32]) -> Result<(), WorkError> {
        let Some(work) = &mut self.work else {
            return Ok(());
        };
        let before = work.len();
        work.extend(genomes)?;
        let after = work.len();
        self.enqueue(before..after);
        Ok(())
    }

    fn enqueue(&mut self, evaluations: Range<usize>) {
        let (count, episodes) = (evaluations.len(), self.episodes());
        if count == 0 {
            return;
        }
        let size = self.settled.len() + count;
        self.results.fitness.resize(size, f64::NAN);
        self.results.metrics.resize(size * self.metrics, f64::NAN);
        self.settled.resize(size, false);
        self.holders.resize(size, 1);
        self.by.resize(size, 0);
        self.open.resize(size / episodes, episodes);
        self.queued += count;
        // What was never tried waits in one piece.
        match self.queue.back_mut() {
            Some(last)
                if last.tries == 0
                    && last.purpose == Purpose::Work
                    && last.evaluations.end == evaluations.start =>
            {
                last.evaluations.end = evaluations.end;
            }
            _ => self.queue.push_back(Piece::new(evaluations)),
        }
    }

    /// The server of each result of the candidates that have ended since `take_settled`.
    pub fn authors(&self) -> Vec<u64> {
        let episodes = self.episodes();
        let base = self.forgotten / episodes;
        let rows = self.fresh.iter().map(|candidate| candidate - base);
        let places = rows.flat_map(|row| row * episodes..(row + 1) * episodes);
        let places = places.filter(|place| !self.results.fitness[*place].is_nan());
        places.map(|place| self.by[place]).collect()
    }

    /// The candidates that have ended since the last call. What they need is forgotten by and by.
    pub fn take_settled(&mut self) -> Settled {
        let (episodes, metrics) = (self.episodes(), self.episodes() * self.metrics);
        let base = self.forgotten / episodes;
        let mut found = Settled {
            candidates: std::mem::take(&mut self.fresh),
            ..Settled::default()
        };
        for candidate in &found.candidates {
            let row = candidate - base;
            let fitness = &self.results.fitness[row * episodes..][..episodes];
            found.fitness.extend_from_slice(fitness);
            let values = &self.results.metrics[row * metrics..][..metrics];
            found.metrics.extend_from_slice(values);
        }
        let ended = self.open.iter().take_while(|open| **open == 0).count();
        // What succeeded last may be needed to tell which servers are sound.
        let kept = self.good.map_or(usize::MAX, |good| good / episodes - base);
        let ended = ended.min(kept);
        if ended * episodes >= WORTH.max(self.settled.len() / 2) {
            self.settled.drain(..ended * episodes);
            self.holders.drain(..ended * episodes);
            self.by.drain(..ended * episodes);
            self.results.fitness.drain(..ended * episodes);
            self.results.metrics.drain(..ended * metrics);
            self.open.drain(..ended);
            self.forgotten += ended * episodes;
            if let Some(work) = &mut self.work {
                work.forget_before(base + ended);
            }
        }
        found
    }

    pub fn work(&self) -> Option<&Work> {
        self.work.as_ref()
    }

    /// What is held against evaluations.
    pub fn suspicions(&self) -> &Suspicions {
        &self.suspicions
    }

    pub fn suspicions_mut(&mut self) -> &mut Suspicions {
        &mut self.suspicions
    }

    pub fn episodes(&self) -> usize {
        self.work.as_ref().map_or(1, Work::episodes)
    }

    /// Candidates and episodes of a piece.
    pub fn extent(&self, piece: &Piece) -> (Range<usize>, Range<usize>) {
        let episodes = self.episodes();
        let (first, length) = (piece.first(), piece.len());
        let (candidate, episode) = (first / episodes, first % episodes);
        (
            candidate..candidate + length.div_ceil(episodes),
            episode..episode + length.min(episodes),
        )
    }

    /// Evaluations that wait for a server.
    pub fn queued(&self) -> usize {
        self.queued
    }

    /// Evaluations that have ended.
    pub fn done(&self) -> usize {
        self.done
    }

    /// Whether something waits that failed before.
    pub fn has_failures(&self) -> bool {
        self.queue.iter().any(|piece| piece.tries > 0)
    }

    pub fn finished(&self) -> bool {
        self.done == self.forgotten + self.settled.len()
    }

    /// Which piece is next for a server: one that it may have and has not failed, or which all of `servers` have.
    fn position(&self, server: u64, servers: &[u64]) -> Option<usize> {
        let found = self.queue.iter().position(|piece| {
            !self.needs_proof(piece, server) && self.may_have(piece, server, servers)
        });
        // A server that can be proven otherwise does not get what others were lost with, nor again what it failed.
        found.or_else(|| match self.good {
            Some(_) => None,
            None => self.barred(server, servers),
        })
    }

    /// Whether a server has to succeed with something else first: after others were lost with a piece, and after it
    /// failed it itself.
    fn needs_proof(&self, piece: &Piece, server: u64) -> bool {
        let suspicions = &self.suspicions;
        let evaluation = piece.first();
        (suspicions.is_suspect(evaluation) && !suspicions.is_proven(server))
            || suspicions.is_open(evaluation, server)
    }

    /// What a server could have if it had succeeded with something.
    fn barred(&self, server: u64, servers: &[u64]) -> Option<usize> {
        if self.suspicions.is_empty() {
            return None;
        }
        let mut queue = self.queue.iter();
        queue.position(|piece| self.may_have(piece, server, servers))
    }

    fn may_have(&self, piece: &Piece, server: u64, servers: &[u64]) -> bool {
        let free = !piece.is_kept_from(server) || !self.is_elsewhere(piece);
        let failed = |server: &u64| piece.has_failed_on(*server);
        let waits = self.suspicions.must_wait(piece.first());
        free && !waits && (!failed(&server) || servers.iter().all(failed))
    }

    /// Whether nothing waits for a server but what it may have only once it has succeeded with something.
    pub fn waits_for_proof(&self, server: u64, servers: &[u64]) -> bool {
        self.position(server, servers).is_none() && self.barred(server, servers).is_some()
    }

    /// The last evaluation that has succeeded.
    pub fn good(&self) -> Option<usize> {
        self.good
    }

    /// Whether [`take`](Self::take) would give a server something.
    pub fn has_for(&self, server: u64, servers: &[u64]) -> bool {
        self.position(server, servers).is_some()
    }

    /// A rectangle of at most `most` evaluations that this server may have and has not failed, or which all of `servers`
    /// have.
    pub fn take(&mut self, server: u64, servers: &[u64], most: usize) -> Option<Piece> {
        let position = self.position(server, servers)?;
        let episodes = self.episodes();
        let piece = &mut self.queue[position];
        let count = rectangle(&piece.evaluations, episodes, most.min(piece.largest()));
        let taken = piece.part(piece.first()..piece.first() + count);
        piece.evaluations.start += count;
        if piece.evaluations.is_empty() {
            self.queue.remove(position);
        }
        self.queued -= count;
        Some(taken)
    }

    /// Whether a server that must not have a piece is to be left out indeed: an audit always; a copy only as long as
    /// somebody else is at all of it.
    fn is_elsewhere(&self, piece: &Piece) -> bool {
        let shared = |evaluation| {
            self.place(evaluation)
                .is_none_or(|place| self.holders[place] > 1)
        };
        piece.purpose == Purpose::Audit || piece.evaluations.clone().all(shared)
    }

    /// What of a piece is not settled waits for a server again, before all else, unless another server has it.
    pub fn put_back(&mut self, piece: &Piece) {
        if piece.purpose == Purpose::Audit {
            self.queued += piece.len();
            return self.queue.push_back(piece.clone());
        }
        let mut waits = Vec::with_capacity(piece.len());
        for evaluation in piece.evaluations.clone() {
            waits.push(self.let_go(evaluation) == Some(0));
            if waits.last() == Some(&true)
                && let Some(place) = self.place(evaluation)
            {
                self.holders[place] = 1;
            }
        }
        // From the end on, so that the first comes first.
        let mut end = waits.len();
        while let Some(last) = waits[..end].iter().rposition(|waits| *waits) {
            let before = waits[..last].iter().rposition(|waits| !waits);
            let first = before.map_or(0, |index| index + 1);
            self.queued += last + 1 - first;
            let part = piece.first() + first..piece.first() + last + 1;
            self.queue.push_front(piece.work_again(part));
            end = first;
        }
    }

    /// Somebody does not have an evaluation any more. In how many other places it is; none if it has ended.
    fn let_go(&mut self, evaluation: usize) -> Option<u8> {
        let place = self.place(evaluation)?;
        self.holders[place] = self.holders[place].saturating_sub(1);
        Some(self.holders[place])
    }

    /// Notes that what of a piece has not ended will be in one more place.
    pub fn hold(&mut self, piece: &Piece) {
        for evaluation in piece.evaluations.clone() {
            if let Some(place) = self.place(evaluation) {
                self.holders[place] = self.holders[place].saturating_add(1);
            }
        }
    }

    /// A copy of work under way, or an audit, waits for a server: copies before all else.
    pub fn queue(&mut self, piece: Piece) {
        if piece.purpose == Purpose::Backup {
            return self.queue_first(piece);
        }
        self.queued += piece.len();
        self.queue.push_back(piece);
    }

    /// As [`queue`](Self::queue), before all else.
    pub fn queue_first(&mut self, piece: Piece) {
        self.queued += piece.len();
        self.queue.push_front(piece);
    }

    /// Whether an evaluation is in more than one place.
    pub fn is_shared(&self, evaluation: usize) -> bool {
        self.place(evaluation)
            .is_some_and(|place| self.holders[place] > 1)
    }

    /// The first of some evaluations that have not ended, and those right behind it.
    pub fn first_open(&self, evaluations: &Range<usize>) -> Option<Range<usize>> {
        let first = evaluations.clone().find(|one| !self.has_ended(*one))?;
        let end = (first..evaluations.end).find(|one| self.has_ended(*one));
        Some(first..end.unwrap_or(evaluations.end))
    }

    /// Whether an evaluation has ended.
    pub fn has_ended(&self, evaluation: usize) -> bool {
        self.place(evaluation).is_none()
    }

    /// Where an evaluation that has not ended stands in the lists.
    fn place(&self, evaluation: usize) -> Option<usize> {
        let place = evaluation.checked_sub(self.forgotten)?;
        (!self.settled[place]).then_some(place)
    }

    /// What is left of an evaluation waits until its servers are vouched for, unless another one has it.
    pub fn put_aside(&mut self, piece: Piece) {
        self.unqueue(piece.first());
        if self.let_go(piece.first()) == Some(0) {
            self.suspicions.put_aside(piece);
        }
    }

    /// Takes an evaluation that was put aside and that a server has not failed.
    pub fn take_aside_for(&mut self, server: u64) -> Option<Piece> {
        let piece = self.suspicions.take_aside_for(server)?;
        if let Some(place) = self.place(piece.first()) {
            self.holders[place] = 1;
        }
        Some(piece)
    }

    /// An evaluation has ended with the result of a server. Whether that is news: what comes later is not heard.
    pub fn settle(
        &mut self,
        evaluation: usize,
        server: u64,
        fitness: f64,
        metrics: &[f64],
    ) -> bool {
        let Some(place) = self.place(evaluation) else {
            return false;
        };
        if self.holders[place] > 1 {
            self.unqueue(evaluation);
        }
        self.results.fitness[place] = fitness;
        self.results.metrics[place * self.metrics..][..self.metrics].copy_from_slice(metrics);
        self.by[place] = server;
        self.good = Some(evaluation);
        self.end(place);
        true
    }

    /// An evaluation has failed for good, its numbers stay NaN. Whether it has: unless it is to be `everywhere`, another
    /// server that is at it may still have a result.
    pub fn give_up(&mut self, evaluation: usize, everywhere: bool) -> bool {
        self.unqueue(evaluation);
        let others = self.let_go(evaluation);
        if others.is_none() || (others != Some(0) && !everywhere) {
            return false;
        }
        if let Some(place) = self.place(evaluation) {
            self.end(place);
        }
        true
    }

    /// Takes an evaluation out of the queue, where a copy of it may wait, or its audit.
    pub fn unqueue(&mut self, evaluation: usize) {
        let holds = |piece: &Piece| piece.evaluations.contains(&evaluation);
        while let Some(position) = self.queue.iter().position(holds) {
            let Some(piece) = self.queue.remove(position) else {
                return;
            };
            let parts = [
                piece.first()..evaluation,
                evaluation + 1..piece.evaluations.end,
            ];
            self.queued -= 1;
            if piece.purpose != Purpose::Audit {
                self.let_go(evaluation);
            }
            for part in parts.into_iter().rev().filter(|part| !part.is_empty()) {
                self.queue.insert(position, piece.part(part));
            }
        }
    }

    fn end(&mut self, place: usize) {
        let episodes = self.episodes();
        self.settled[place] = true;
        self.suspicions.forget(self.forgotten + place);
        self.done += 1;
        self.open[place / episodes] -= 1;
        if self.open[place / episodes] == 0 {
            self.fresh.push((self.forgotten + place) / episodes);
        }
    }

    /// A server's results are worth nothing: what it did waits for another one. Returns how many evaluations do, and how
    /// many cannot, since their candidates have been handed out.
    pub fn reopen(&mut self, server: u64) -> (usize, usize) {
        let episodes = self.episodes();
        let base = self.forgotten / episodes;
        let here: HashSet<usize> = self.fresh.iter().copied().collect();
        let (mut reopened, mut lost) = (0, 0);
        for place in (0..self.settled.len()).rev() {
            if !self.settled[place]
                || self.by[place] != server
                || self.results.fitness[place].is_nan()
            {
                continue;
            }
            let candidate = place / episodes;
            if self.open[candidate] == 0 && !here.contains(&(base + candidate)) {
                lost += 1;
                continue;
            }
            self.settled[place] = false;
            self.results.fitness[place] = f64::NAN;
            self.results.metrics[place * self.metrics..][..self.metrics].fill(f64::NAN);
            self.holders[place] = 1;
            self.done -= 1;
            self.open[candidate] += 1;
            self.queued += 1;
            let evaluation = self.forgotten + place;
            self.good = self.good.filter(|good| *good != evaluation);
            match self.queue.front_mut() {
                Some(next)
                    if next.purpose == Purpose::Work
                        && next.tries == 0
                        && next.first() == evaluation + 1 =>
                {
                    next.evaluations.start = evaluation;
                }
                _ => self
                    .queue
                    .push_front(Piece::new(evaluation..evaluation + 1)),
            }
            reopened += 1;
        }
        let open = &self.open;
        self.fresh.retain(|candidate| open[candidate - base] == 0);
        self.good = self.good.or_else(|| {
            let has_succeeded = |place: &usize| !self.results.fitness[*place].is_nan();
            let found = (0..self.settled.len()).rev().find(has_succeeded);
            found.map(|place| self.forgotten + place)
        });
        (reopened, lost)
    }

    /// The results of all evaluations, once all have ended.
    pub fn take_results(&mut self) -> Results {
        std::mem::take(self).results
    }
}

#[cfg(test)]
mod tests;

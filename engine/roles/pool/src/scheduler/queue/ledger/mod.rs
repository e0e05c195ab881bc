//! Ledger of the evaluations of the current work, queued and done. They are numbered by candidate, then by episode.

pub(crate) mod failures;
mod queue;

use std::collections::{HashSet, VecDeque};
use std::ops::Range;

use crate::scheduler::queue::blame::Attribution;
use crate::scheduler::queue::piece::{Piece, Purpose};
use crate::scheduler::queue::results::{Results, ServerResult, Settled};
use crate::work::{Repetition, Work, WorkError};

/// Smallest number of evaluations that is worth forgetting.
const MIN_FORGOTTEN: usize = 4096;

/// Ledger of one block of work.
#[derive(Debug, Default)]
pub(crate) struct Ledger {
    work: Option<Work>,
    queue: VecDeque<Piece>,
    queued: usize,
    results: Results,
    /// Number of metrics of each evaluation.
    metrics: usize,
    settled: Vec<bool>,
    /// Number of places in which each evaluation is queued or in flight.
    holders: Vec<u8>,
    /// Server of each result.
    by: Vec<u64>,
    /// Failures attributed to evaluations.
    attribution: Attribution,
    /// The last evaluation that succeeded.
    good: Option<usize>,
    done: usize,
    /// Evaluations before this index have ended and are forgotten; all lists of evaluations begin here.
    forgotten: usize,
    /// Number of open episodes of each candidate, counted from the first candidate that is not forgotten.
    open: Vec<usize>,
    /// Candidates that have ended since the last call of `take_settled`.
    fresh: Vec<usize>,
}

impl Ledger {
    pub fn new(work: Work, metrics: usize) -> Self {
        let count = work.len();
        let only = work.repetitions().map(<[Repetition]>::to_vec);
        let mut ledger = Self {
            work: Some(work),
            metrics,
            ..Self::default()
        };
        ledger.enqueue(0..count);
        if let Some(only) = only {
            ledger.restrict(&only);
        }
        ledger
    }

    /// Ends all evaluations except these, before any was given to a server.
    fn restrict(&mut self, only: &[Repetition]) {
        let episodes = self.episodes();
        self.queue.clear();
        self.queued = 0;
        self.settled.fill(true);
        self.holders.fill(0);
        self.open.fill(0);
        self.done = self.settled.len();
        for repetition in only {
            let evaluation = repetition.candidate * episodes + repetition.episode;
            if !std::mem::replace(&mut self.settled[evaluation], false) {
                continue;
            }
            self.holders[evaluation] = 1;
            self.open[repetition.candidate] += 1;
            self.done -= 1;
            self.queued += 1;
            self.queue
                .push_back(Piece::repetition(evaluation, repetition.before));
        }
    }

    /// Returns whether the work repeats earlier evaluations.
    pub fn repeats(&self) -> bool {
        let work = self.work.as_ref();
        work.is_some_and(|work| work.repetitions().is_some())
    }

    /// Returns whether candidates that have been returned may be returned again.
    pub fn is_revised(&self) -> bool {
        self.work.as_ref().is_some_and(Work::is_revised)
    }

    /// Adds candidates at the end; see [`Work::extend`].
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
        // Merge untried evaluations into one piece.
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

    /// Returns the server of each result of the candidates that have ended since the last call of `take_settled`.
    pub fn authors(&self) -> Vec<u64> {
        let episodes = self.episodes();
        let base = self.forgotten / episodes;
        let rows = self.fresh.iter().map(|candidate| candidate - base);
        let places = rows.flat_map(|row| row * episodes..(row + 1) * episodes);
        let places = places.filter(|index| !self.results.fitness[*index].is_nan());
        places.map(|index| self.by[index]).collect()
    }

    /// Takes the candidates that have ended since the last call, and from time to time frees the memory of ended
    /// candidates.
    pub fn take_settled(&mut self) -> Settled {
        let (episodes, metrics) = (self.episodes(), self.episodes() * self.metrics);
        let base = self.forgotten / episodes;
        let mut settled = Settled {
            candidates: std::mem::take(&mut self.fresh),
            ..Settled::default()
        };
        for candidate in &settled.candidates {
            let row = candidate - base;
            let fitness = &self.results.fitness[row * episodes..][..episodes];
            settled.fitness.extend_from_slice(fitness);
            let values = &self.results.metrics[row * metrics..][..metrics];
            settled.metrics.extend_from_slice(values);
        }
        let ended = self.open.iter().take_while(|open| **open == 0).count();
        // The last success may be needed for probes.
        let needed = self.good.map_or(usize::MAX, |good| good / episodes - base);
        let ended = ended.min(needed);
        if ended * episodes >= MIN_FORGOTTEN.max(self.settled.len() / 2) && !self.is_revised() {
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
        settled
    }

    pub fn work(&self) -> Option<&Work> {
        self.work.as_ref()
    }

    /// Returns the failures attributed to evaluations.
    pub fn attribution(&self) -> &Attribution {
        &self.attribution
    }

    pub fn attribution_mut(&mut self) -> &mut Attribution {
        &mut self.attribution
    }

    pub fn episodes(&self) -> usize {
        self.work.as_ref().map_or(1, Work::episodes)
    }

    /// Returns the candidates and the episodes of a piece.
    pub fn extent(&self, piece: &Piece) -> (Range<usize>, Range<usize>) {
        let episodes = self.episodes();
        let (first, length) = (piece.first(), piece.len());
        let (candidate, episode) = (first / episodes, first % episodes);
        (
            candidate..candidate + length.div_ceil(episodes),
            episode..episode + length.min(episodes),
        )
    }

    /// Describes an evaluation for users.
    pub fn name_of(&self, evaluation: usize) -> String {
        let episodes = self.episodes();
        let (candidate, episode) = (evaluation / episodes, evaluation % episodes);
        format!("candidate {candidate} in episode {episode}")
    }

    /// Describes the results of several servers for an evaluation.
    pub fn describe(&self, evaluation: usize, results: &[ServerResult]) -> String {
        let each: Vec<String> = results
            .iter()
            .map(|result| format!("{} on server {}", result.fitness, result.server))
            .collect();
        format!(
            "{} has the fitness {}",
            self.name_of(evaluation),
            each.join(", ")
        )
    }

    /// Returns the number of evaluations that wait for a server.
    pub fn queued(&self) -> usize {
        self.queued
    }

    /// Returns the number of evaluations that have ended.
    pub fn done(&self) -> usize {
        self.done
    }

    /// Returns whether any queued piece has failed before.
    pub fn has_failures(&self) -> bool {
        self.queue.iter().any(|piece| piece.tries > 0)
    }

    pub fn finished(&self) -> bool {
        self.done == self.forgotten + self.settled.len()
    }

    /// Returns the last evaluation that succeeded.
    pub fn good(&self) -> Option<usize> {
        self.good
    }

    /// Returns whether an evaluation is in more than one place.
    pub fn is_shared(&self, evaluation: usize) -> bool {
        self.place(evaluation)
            .is_some_and(|index| self.holders[index] > 1)
    }

    /// Returns the first run of consecutive evaluations in the range that have not ended.
    pub fn first_open(&self, evaluations: &Range<usize>) -> Option<Range<usize>> {
        let first = evaluations
            .clone()
            .find(|evaluation| !self.has_ended(*evaluation))?;
        let end = (first..evaluations.end).find(|evaluation| self.has_ended(*evaluation));
        Some(first..end.unwrap_or(evaluations.end))
    }

    /// Returns whether an evaluation has ended.
    pub fn has_ended(&self, evaluation: usize) -> bool {
        self.place(evaluation).is_none()
    }

    /// Returns whether no result of a piece is awaited any more now that this evaluation has ended.
    pub fn is_over(&self, piece: &Piece, evaluation: usize) -> bool {
        !matches!(piece.purpose, Purpose::Audit | Purpose::Probe)
            && piece.evaluations.contains(&evaluation)
            && piece.evaluations.clone().all(|other| self.has_ended(other))
    }

    /// Returns the index of an unfinished evaluation in the lists.
    fn place(&self, evaluation: usize) -> Option<usize> {
        let index = evaluation.checked_sub(self.forgotten)?;
        (!self.settled[index]).then_some(index)
    }

    /// Ends an evaluation with the result of a server. Returns false, and ignores the result, if it had already ended.
    pub fn settle(
        &mut self,
        evaluation: usize,
        server: u64,
        fitness: f64,
        metrics: &[f64],
    ) -> bool {
        let Some(index) = self.place(evaluation) else {
            return false;
        };
        if self.holders[index] > 1 {
            self.unqueue(evaluation);
        }
        self.results.fitness[index] = fitness;
        self.results.metrics[index * self.metrics..][..self.metrics].copy_from_slice(metrics);
        self.by[index] = server;
        self.good = Some(evaluation);
        self.end(index);
        true
    }

    /// Ends evaluations without metrics with the results of a server. Returns false without any effect if one of them
    /// has already ended or is in more than one place, or if failures are attributed to any evaluation.
    pub fn settle_whole(
        &mut self,
        evaluations: &Range<usize>,
        server: u64,
        fitness: &[f64],
    ) -> bool {
        let Some(first) = evaluations.start.checked_sub(self.forgotten) else {
            return false;
        };
        let places = first..first + evaluations.len();
        let open = !self.settled[places.clone()].contains(&true);
        let alone = self.holders[places.clone()].iter().all(|count| *count <= 1);
        if !(open && alone && self.metrics == 0 && self.attribution.is_empty()) || places.is_empty()
        {
            return false;
        }
        self.results.fitness[places.clone()].copy_from_slice(fitness);
        self.by[places.clone()].fill(server);
        self.settled[places.clone()].fill(true);
        self.good = Some(evaluations.end - 1);
        self.done += places.len();
        let (episodes, forgotten) = (self.episodes(), self.forgotten);
        for candidate in places.start / episodes..places.end.div_ceil(episodes) {
            let (start, end) = (candidate * episodes, (candidate + 1) * episodes);
            self.open[candidate] -= end.min(places.end) - start.max(places.start);
            if self.open[candidate] == 0 {
                self.fresh.push(forgotten / episodes + candidate);
            }
        }
        true
    }

    /// Ends an evaluation that has failed permanently; its values stay NaN. Returns whether it has ended: unless
    /// `everywhere` is set, another server that is working on it may still return a result.
    pub fn give_up(&mut self, evaluation: usize, everywhere: bool) -> bool {
        self.unqueue(evaluation);
        let others = self.let_go(evaluation);
        if others.is_none() || (others != Some(0) && !everywhere) {
            return false;
        }
        if let Some(index) = self.place(evaluation) {
            self.end(index);
        }
        true
    }

    fn end(&mut self, index: usize) {
        let episodes = self.episodes();
        self.settled[index] = true;
        self.attribution.forget(self.forgotten + index);
        self.done += 1;
        self.open[index / episodes] -= 1;
        if self.open[index / episodes] == 0 {
            self.fresh.push((self.forgotten + index) / episodes);
        }
    }

    /// Discards a server's results and queues their evaluations again. Returns the number of queued evaluations, and
    /// the number that cannot be repeated because their candidates have been returned.
    pub fn reopen(&mut self, server: u64) -> (usize, usize) {
        let episodes = self.episodes();
        let base = self.forgotten / episodes;
        let fresh: HashSet<usize> = self.fresh.iter().copied().collect();
        let (mut reopened, mut lost) = (0, 0);
        for index in (0..self.settled.len()).rev() {
            if !self.settled[index]
                || self.by[index] != server
                || self.results.fitness[index].is_nan()
            {
                continue;
            }
            let candidate = index / episodes;
            let is_out = self.open[candidate] == 0 && !fresh.contains(&(base + candidate));
            if is_out && !self.is_revised() {
                lost += 1;
                continue;
            }
            self.settled[index] = false;
            self.results.fitness[index] = f64::NAN;
            self.results.metrics[index * self.metrics..][..self.metrics].fill(f64::NAN);
            self.holders[index] = 1;
            self.done -= 1;
            self.open[candidate] += 1;
            self.queued += 1;
            let evaluation = self.forgotten + index;
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
            let has_succeeded = |index: &usize| !self.results.fitness[*index].is_nan();
            let last = (0..self.settled.len()).rev().find(has_succeeded);
            last.map(|index| self.forgotten + index)
        });
        (reopened, lost)
    }

    /// Takes the results of all evaluations, once all have ended, and the work.
    pub fn take_results(&mut self) -> (Results, Option<Work>) {
        let ended = std::mem::take(self);
        (ended.results, ended.work)
    }
}

#[cfg(test)]
mod tests;

//! What of the work is queued and what is done. Evaluations are numbered candidate by candidate, episode by episode.

use std::collections::VecDeque;
use std::ops::Range;

use crate::work::{Work, WorkError};

/// How many of the evaluations `queued`, from the first on and at most `most`, make a rectangle: whole candidates, or
/// some episodes of one. At least 1, unless nothing is queued.
#[must_use]
pub fn rectangle(queued: &Range<usize>, episodes: usize, most: usize) -> usize {
    let length = queued.len().min(most.max(1));
    let episode = queued.start % episodes;
    if episode == 0 && length >= episodes {
        length - length % episodes
    } else {
        length.min(episodes - episode)
    }
}

/// What came out of all evaluations of some work.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Results {
    /// (candidates, episodes), row-major, NaN where all attempts failed.
    pub fitness: Vec<f64>,
    /// (candidates, episodes, metrics that are needed), row-major, NaN where all attempts failed.
    pub metrics: Vec<f64>,
}

/// Candidates of which all episodes have ended.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Settled {
    /// Their numbers, in the order in which they ended.
    pub candidates: Vec<usize>,
    /// (candidates, episodes), row-major, NaN where all attempts failed.
    pub fitness: Vec<f64>,
    /// (candidates, episodes, metrics that are needed), row-major, NaN where all attempts failed.
    pub metrics: Vec<f64>,
}

/// Fewer evaluations than these are not worth forgetting.
const WORTH: usize = 4096;

/// Evaluations in a row that have the same past.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Piece {
    pub evaluations: Range<usize>,
    /// Attempts made before.
    pub tries: u32,
    /// Servers on which it failed: others are preferred.
    failed_on: Vec<u64>,
    /// How many of it may go in one request: fewer with each failure, so that in the end the one that brings servers
    /// down is alone.
    largest: usize,
}

impl Piece {
    pub fn first(&self) -> usize {
        self.evaluations.start
    }

    pub fn len(&self) -> usize {
        self.evaluations.len()
    }

    /// A part of it, with the same past.
    pub fn part(&self, evaluations: Range<usize>) -> Self {
        Self {
            evaluations,
            ..self.clone()
        }
    }

    /// What it is after a failure on a server.
    pub fn failed(mut self, server: u64, attempts: u32) -> Self {
        self.tries += 1;
        self.failed_on.push(server);
        self.largest = if self.tries + 1 >= attempts {
            1
        } else {
            self.len().div_ceil(8)
        };
        self
    }
}

/// The books of one block of work.
#[derive(Debug, Default)]
pub(crate) struct Ledger {
    pub work: Option<Work>,
    queue: VecDeque<Piece>,
    queued: usize,
    results: Results,
    /// How many metrics each evaluation has.
    metrics: usize,
    settled: Vec<bool>,
    done: usize,
    /// Evaluations before this one are forgotten; they have ended. `results` and `settled` begin here.
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
        self.open.resize(size / episodes, episodes);
        self.queued += count;
        // What was never tried waits in one piece.
        match self.queue.back_mut() {
            Some(last) if last.tries == 0 && last.evaluations.end == evaluations.start => {
                last.evaluations.end = evaluations.end;
            }
            _ => self.queue.push_back(Piece {
                evaluations,
                tries: 0,
                failed_on: Vec::new(),
                largest: usize::MAX,
            }),
        }
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
        if ended * episodes >= WORTH.max(self.settled.len() / 2) {
            self.settled.drain(..ended * episodes);
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

    /// Which piece is next for a server.
    fn position(&self, server: u64, servers: &[u64]) -> Option<usize> {
        self.queue.iter().position(|piece| {
            !piece.failed_on.contains(&server)
                || servers.iter().all(|other| piece.failed_on.contains(other))
        })
    }

    /// Whether [`take`](Self::take) would give a server something.
    pub fn has_for(&self, server: u64, servers: &[u64]) -> bool {
        self.position(server, servers).is_some()
    }

    /// A rectangle of at most `most` evaluations that this server has not failed, or which all of `servers` have.
    pub fn take(&mut self, server: u64, servers: &[u64], most: usize) -> Option<Piece> {
        let position = self.position(server, servers)?;
        let episodes = self.episodes();
        let piece = &mut self.queue[position];
        let count = rectangle(&piece.evaluations, episodes, most.min(piece.largest));
        let taken = piece.part(piece.first()..piece.first() + count);
        piece.evaluations.start += count;
        if piece.evaluations.is_empty() {
            self.queue.remove(position);
        }
        self.queued -= count;
        Some(taken)
    }

    /// What of a piece is not settled waits for a server again, before all else.
    pub fn put_back(&mut self, piece: &Piece) {
        let mut end = piece.evaluations.end;
        while end > piece.first() {
            let open = |index: &usize| self.place(*index).is_some();
            let from_end = || (piece.first()..end).rev();
            let Some(last) = from_end().find(open) else {
                return;
            };
            let before = (piece.first()..last).rev().find(|index| !open(index));
            let first = before.map_or(piece.first(), |index| index + 1);
            self.queued += last + 1 - first;
            self.queue.push_front(piece.part(first..last + 1));
            end = first;
        }
    }

    /// Where an evaluation that has not ended stands in the lists.
    fn place(&self, evaluation: usize) -> Option<usize> {
        let place = evaluation.checked_sub(self.forgotten)?;
        (!self.settled[place]).then_some(place)
    }

    /// An evaluation has ended. Whatever comes later for it is not heard.
    pub fn settle(&mut self, evaluation: usize, fitness: f64, metrics: &[f64]) {
        if let Some(place) = self.place(evaluation) {
            self.results.fitness[place] = fitness;
            self.results.metrics[place * self.metrics..][..self.metrics].copy_from_slice(metrics);
            self.end(place);
        }
    }

    /// An evaluation has failed for good: its numbers stay NaN.
    pub fn give_up(&mut self, evaluation: usize) {
        if let Some(place) = self.place(evaluation) {
            self.end(place);
        }
    }

    fn end(&mut self, place: usize) {
        let episodes = self.episodes();
        self.settled[place] = true;
        self.done += 1;
        self.open[place / episodes] -= 1;
        if self.open[place / episodes] == 0 {
            self.fresh.push((self.forgotten + place) / episodes);
        }
    }

    /// The results of all evaluations, once all have ended.
    pub fn take_results(&mut self) -> Results {
        std::mem::take(self).results
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ARCHITECTURE: &str = r#"{"version": 1, "kind": "layered", "sensors": 1, "actuators": 1, "hidden": [],
        "activation": "tanh", "output_range": [-1, 1]}"#;

    fn ledger(candidates: usize, episodes: u64) -> Ledger {
        let work = Work::new(
            ARCHITECTURE,
            vec![0.5; 2 * candidates],
            (0..episodes).collect(),
        );
        Ledger::new(work.unwrap(), 0)
    }

    #[test]
    fn pieces_are_rectangles_and_cover_everything_once() {
        for (candidates, episodes, most) in [
            (7, 3, 1),
            (7, 3, 2),
            (7, 3, 3),
            (7, 3, 7),
            (5, 1, 2),
            (1, 10, 4),
            (4, 2, 100),
        ] {
            let mut ledger = ledger(candidates, episodes);
            let mut next = 0;
            while let Some(piece) = ledger.take(1, &[1], most) {
                assert_eq!(piece.first(), next);
                let (rows, columns) = ledger.extent(&piece);
                assert_eq!(rows.len() * columns.len(), piece.len());
                assert!(piece.len() <= most);
                for index in piece.evaluations.clone() {
                    ledger.settle(index, 1.0, &[]);
                }
                next += piece.len();
            }
            assert!(ledger.finished());
            assert_eq!((ledger.queued(), next), (0, ledger.done()));
        }
    }

    #[test]
    fn what_is_settled_is_not_queued_again() {
        let mut ledger = ledger(4, 2);
        let piece = ledger.take(1, &[1], 8).unwrap();
        for index in [0, 3, 4, 7] {
            ledger.settle(index, 1.0, &[]);
        }
        ledger.put_back(&piece);
        assert_eq!(ledger.queued(), 4);
        let rest: Vec<_> = std::iter::from_fn(|| ledger.take(1, &[1], 8))
            .map(|piece| piece.evaluations)
            .collect();
        assert_eq!(rest, [1..2, 2..3, 5..6, 6..7]);
    }

    #[test]
    fn work_that_grows_is_handed_out_once_and_forgotten_when_it_has_ended() {
        let mut ledger = ledger(4, 2);
        let (mut seen, mut made) = (Vec::new(), 4);
        let mut next = 0;
        while let Some(piece) = ledger.take(1, &[1], 3) {
            assert_eq!(piece.first(), next);
            next += piece.len();
            for index in piece.evaluations.clone().rev() {
                ledger.settle(index, f64::from(u32::try_from(index).unwrap()), &[]);
                ledger.settle(index, -1.0, &[]);
            }
            let settled = ledger.take_settled();
            for (row, candidate) in settled.candidates.iter().enumerate() {
                let first = f64::from(u32::try_from(2 * candidate).unwrap());
                assert_eq!(settled.fitness[2 * row..][..2], [first, first + 1.0]);
                seen.push(*candidate);
                if made < 20_000 {
                    ledger.extend(&[0.5; 2]).unwrap();
                    made += 1;
                }
            }
            assert!(ledger.settled.len() < 4 * WORTH);
            // What comes late for something forgotten changes nothing.
            ledger.settle(0, -1.0, &[]);
            ledger.put_back(&piece);
            assert!(ledger.queued() <= 8);
        }
        seen.sort_unstable();
        assert_eq!(seen, (0..20_000).collect::<Vec<_>>());
        assert!(ledger.finished());
        assert!(ledger.forgotten > 0);
        assert_eq!(
            ledger.extend(&[f32::NAN, 0.0]),
            Err(WorkError::NotFinite {
                candidate: 0,
                weight: 0
            })
        );
    }

    #[test]
    fn what_failed_goes_to_others_first_and_in_ever_smaller_parts() {
        let mut ledger = ledger(64, 1);
        let piece = ledger.take(1, &[1, 2], 64).unwrap();
        ledger.put_back(&piece.failed(1, 3));
        assert_eq!(ledger.take(1, &[1, 2], 64), None);
        let again = ledger.take(2, &[1, 2], 64).unwrap();
        assert_eq!(again.evaluations, 0..8);
        ledger.put_back(&again.failed(2, 3));
        assert_eq!(ledger.take(1, &[1, 2], 64).unwrap().evaluations, 0..1);
        // No server is left that has not failed it; the rest waits for the other one.
        assert_eq!(ledger.take(2, &[1, 2], 64).unwrap().evaluations, 1..2);
    }
}

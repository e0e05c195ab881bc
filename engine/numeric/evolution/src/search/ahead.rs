//! Normal numbers of generation after generation; those of some to come are drawn while this one is used.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};

use rayon::prelude::*;

use crate::stream::{normal_rows, rows_of};

/// Numbers, 64 MiB: larger samples are not drawn ahead.
const MOST: usize = 1 << 24;

/// Numbers that are made in little more time than another thread takes to begin.
const FEW: usize = 1 << 14;

/// Number of values that are drawn ahead: those of whole generations, of at least one.
const AHEAD: usize = 1 << 16;

/// See the module.
#[derive(Debug)]
pub(super) struct Ahead {
    address: Address,
    batch: Option<Batch>,
}

/// Which numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Address {
    pub(super) seed: u64,
    pub(super) purpose: u64,
    /// Streams, each of which gives a row.
    pub(super) rows: u64,
    /// Numbers in a row.
    pub(super) length: usize,
}

/// Generations that another thread draws, and this one where the other has not begun with them.
#[derive(Debug)]
struct Batch {
    /// The next generation that no thread has begun with.
    free: Arc<AtomicU64>,
    end: u64,
    drawn: Mutex<Receiver<(u64, Vec<f32>)>>,
}

impl Ahead {
    pub(super) fn new(address: Address) -> Self {
        Self {
            address,
            batch: None,
        }
    }

    /// Rows of numbers of a generation.
    pub(super) fn draw(&mut self, generation: u64) -> Vec<f32> {
        let batch = self.batch.as_mut().and_then(|batch| batch.take(generation));
        let drawn = batch.unwrap_or_else(|| self.address.drawn(generation));
        let next = generation.wrapping_add(1);
        let used = self.batch.as_ref().is_none_or(|batch| batch.end <= next);
        if used && drawn.len() <= MOST {
            let generations = (AHEAD / drawn.len().max(1)).max(1) as u64;
            self.batch = Some(Batch::begin(
                self.address,
                next,
                next.saturating_add(generations),
            ));
        }
        drawn
    }
}

impl Batch {
    fn begin(address: Address, first: u64, end: u64) -> Self {
        let free = Arc::new(AtomicU64::new(first));
        let (send, drawn) = channel();
        let begun = free.clone();
        rayon::spawn(move || draw_free(address, &begun, end, &send));
        Self {
            free,
            end,
            drawn: Mutex::new(drawn),
        }
    }

    /// Waits for the numbers that the other thread draws for a generation; `None` if it has not begun them.
    fn take(&mut self, generation: u64) -> Option<Vec<f32>> {
        let next = generation + 1;
        if generation >= self.end
            || self
                .free
                .compare_exchange(generation, next, Ordering::Relaxed, Ordering::Relaxed)
                .is_ok()
        {
            return None;
        }
        // Those before, if they were not wanted, are thrown away.
        let drawn = self.drawn.get_mut().ok()?;
        let batch = drawn.iter().find(|(of, _)| *of >= generation);
        batch.and_then(|(of, drawn)| (of == generation).then_some(drawn))
    }
}

/// Draws generations until `end`, or until the receiver is dropped.
fn draw_free(address: Address, free: &AtomicU64, end: u64, drawn: &Sender<(u64, Vec<f32>)>) {
    loop {
        let generation = free.fetch_add(1, Ordering::Relaxed);
        if generation >= end || drawn.send((generation, address.drawn(generation))).is_err() {
            return;
        }
    }
}
impl Address {
    fn drawn(self, generation: u64) -> Vec<f32> {
        let length = self.length.max(1);
        let count = usize::try_from(self.rows).unwrap_or(0);
        let mut drawn = vec![0.0; count * self.length];
        let rows = rows_of(FEW, length);
        let draw = |(part, numbers): (usize, &mut [f32])| {
            let first = (part * rows) as u64;
            normal_rows(self.seed, self.purpose, generation, first, length, numbers);
        };
        if drawn.len() < 2 * FEW {
            draw((0, &mut drawn));
        } else {
            let parts = drawn.par_chunks_mut(rows * length);
            parts.enumerate().for_each(draw);
        }
        drawn
    }
}

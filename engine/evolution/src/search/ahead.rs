//! Normal numbers of generation after generation; those of the next one are drawn while this one is used.

use std::sync::Mutex;
use std::sync::mpsc::{Receiver, channel};

use rayon::prelude::*;

use crate::stream::normal_rows;

/// Numbers, 64 MiB: larger samples are not drawn ahead.
const MOST: usize = 1 << 23;

/// Numbers that are made in little more time than another thread takes to begin.
const FEW: usize = 1 << 14;

/// See the module.
#[derive(Debug)]
pub(super) struct Ahead {
    address: Address,
    /// A generation, and where its numbers arrive.
    next: Option<(u64, Mutex<Receiver<Vec<f64>>>)>,
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

impl Ahead {
    pub(super) fn new(address: Address) -> Self {
        Self {
            address,
            next: None,
        }
    }

    /// Rows of numbers of a generation.
    pub(super) fn draw(&mut self, generation: u64) -> Vec<f64> {
        let ready = self.next.take().filter(|(of, _)| *of == generation);
        let drawn = ready
            .and_then(|(_, numbers)| numbers.into_inner().ok()?.recv().ok())
            .unwrap_or_else(|| self.address.drawn(generation));
        if drawn.len() <= MOST {
            let (send, receive) = channel();
            let address = self.address;
            rayon::spawn(move || drop(send.send(address.drawn(generation + 1))));
            self.next = Some((generation + 1, Mutex::new(receive)));
        }
        drawn
    }
}

impl Address {
    fn drawn(self, generation: u64) -> Vec<f64> {
        let length = self.length.max(1);
        let count = usize::try_from(self.rows).unwrap_or(0);
        let mut drawn = vec![0.0; count * self.length];
        let rows = FEW.div_ceil(length);
        let draw = |(part, numbers): (usize, &mut [f64])| {
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

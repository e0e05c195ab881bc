//! Normal numbers of generation after generation; those of the next one are drawn while this one is used.

use std::sync::Mutex;
use std::sync::mpsc::{Receiver, channel};

use crate::stream::{Stream, rows};

/// Numbers, 64 MiB: larger samples are not drawn ahead.
const MOST: usize = 1 << 23;

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
        let stream = |row| Stream::new(self.seed, self.purpose, generation, row);
        let mut streams: Vec<_> = (0..self.rows).map(stream).collect();
        let mut drawn = vec![0.0; streams.len() * self.length];
        rows(&mut streams, &mut drawn, self.length, |_, stream, row| {
            stream.normals(row);
        });
        drawn
    }
}

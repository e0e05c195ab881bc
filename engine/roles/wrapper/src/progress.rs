//! What a server is computing, written where a supervising process can read it, also after the server's end.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Interval of heartbeats: a supervisor looks a few times a second.
const BEAT: Duration = Duration::from_millis(20);
/// Offset of the number of heartbeats.
const BEATS: u64 = 40;
/// In the place of an episode: all of them.
const ALL: u64 = u64::MAX;

/// A small file, best in memory, of six numbers of 64 bits, little-endian: the request, its first candidate that is
/// computed, how many candidates (0: none of a request), the episode (2^64 - 1: all of them, or nothing is computed), evaluations that
/// have ended since the start, signs of life.
#[derive(Debug)]
pub struct Progress {
    file: File,
    ended: AtomicU64,
    beats: AtomicU64,
    start: Instant,
    /// Nanoseconds since the start at which the last sign of life was written.
    last_heartbeat: AtomicU64,
}

impl Progress {
    /// Writes to a file that is there.
    ///
    /// # Errors
    /// It cannot be opened for writing.
    pub fn open(path: &Path) -> io::Result<Self> {
        Ok(Self {
            file: File::options().write(true).open(path)?,
            ended: AtomicU64::new(0),
            beats: AtomicU64::new(0),
            start: Instant::now(),
            last_heartbeat: AtomicU64::new(0),
        })
    }

    /// Candidates of a request are computed, in one of its episodes or in all of them.
    pub(crate) fn at(&self, request: u64, first: usize, candidates: usize, episode: Option<usize>) {
        let episode = episode.map_or(ALL, |episode| episode as u64);
        self.write(request, first as u64, candidates as u64, episode);
    }

    /// So many evaluations have ended.
    pub(crate) fn ended(&self, evaluations: usize) {
        self.ended.fetch_add(evaluations as u64, Ordering::Relaxed);
    }

    /// An episode is stepped, or several at the same time: which ones, only the tool knows.
    pub(crate) fn stepping(&self) {
        self.write(0, 0, 0, 0);
    }

    /// Nothing is computed.
    pub(crate) fn idle(&self) {
        self.write(0, 0, 0, ALL);
    }

    /// A sign of life: a step has been made.
    pub fn beat(&self) {
        let now = u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        let last = self.last_heartbeat.load(Ordering::Relaxed);
        if u128::from(now.saturating_sub(last)) >= BEAT.as_nanos() {
            self.last_heartbeat.store(now, Ordering::Relaxed);
            let beats = self.beats.fetch_add(1, Ordering::Relaxed) + 1;
            // Without it the server would be taken for one that hangs, no more can be done.
            let _ = self.file.write_all_at(&beats.to_le_bytes(), BEATS);
        }
    }

    fn write(&self, request: u64, first: u64, candidates: u64, episode: u64) {
        let beats = self.beats.fetch_add(1, Ordering::Relaxed) + 1;
        let ended = self.ended.load(Ordering::Relaxed);
        let mut bytes = [0; 48];
        let numbers = [request, first, candidates, episode, ended, beats];
        for (slot, number) in bytes.chunks_exact_mut(8).zip(numbers) {
            slot.copy_from_slice(&number.to_le_bytes());
        }
        let _ = self.file.write_all_at(&bytes, 0);
    }
}

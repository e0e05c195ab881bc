//! Progress of a server, written to a file that a supervising process can read even after the server has ended.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Interval between heartbeats; supervisors poll a few times per second.
const BEAT: Duration = Duration::from_millis(20);
/// Byte offset of the number of heartbeats.
const BEATS: u64 = 40;
/// Value of the episode that stands for all episodes.
const ALL: u64 = u64::MAX;

/// A small file, ideally in memory, with six 64-bit little-endian integers: the request, the first candidate being
/// computed, the number of candidates (0 if no request is being computed), the episode (2^64 - 1 for all episodes, or
/// if nothing is computed), the number of evaluations that have ended since the start, and the number of heartbeats.
#[derive(Debug)]
pub struct Progress {
    file: File,
    ended: AtomicU64,
    beats: AtomicU64,
    start: Instant,
    /// Time of the last heartbeat in nanoseconds since the start.
    last_heartbeat: AtomicU64,
}

impl Progress {
    /// Opens an existing file for writing.
    ///
    /// # Errors
    /// Fails if the file cannot be opened for writing.
    pub fn open(path: &Path) -> io::Result<Self> {
        Ok(Self {
            file: File::options().write(true).open(path)?,
            ended: AtomicU64::new(0),
            beats: AtomicU64::new(0),
            start: Instant::now(),
            last_heartbeat: AtomicU64::new(0),
        })
    }

    /// Records that candidates of a request are being computed, in one of its episodes or in all of them.
    pub(crate) fn at(&self, request: u64, first: usize, candidates: usize, episode: Option<usize>) {
        let episode = episode.map_or(ALL, |episode| episode as u64);
        self.write(request, first as u64, candidates as u64, episode);
    }

    /// Adds to the number of evaluations that have ended.
    pub(crate) fn ended(&self, evaluations: usize) {
        self.ended.fetch_add(evaluations as u64, Ordering::Relaxed);
    }

    /// Records that one or more episodes are being stepped; only the tool knows which ones.
    pub(crate) fn stepping(&self) {
        self.write(0, 0, 0, 0);
    }

    /// Records that nothing is being computed.
    pub(crate) fn idle(&self) {
        self.write(0, 0, 0, ALL);
    }

    /// Writes a heartbeat after a step.
    pub fn beat(&self) {
        let now = u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        let last = self.last_heartbeat.load(Ordering::Relaxed);
        if u128::from(now.saturating_sub(last)) >= BEAT.as_nanos() {
            self.last_heartbeat.store(now, Ordering::Relaxed);
            let beats = self.beats.fetch_add(1, Ordering::Relaxed) + 1;
            // If the write fails, the supervisor takes the server for hanging; there is nothing better to do.
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

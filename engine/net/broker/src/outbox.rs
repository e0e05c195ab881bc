//! Bytes to be sent to one client.

use swarmwright_packets::frame;

/// A queue of packets, contiguous so that one system call sends many of them.
#[derive(Default)]
pub struct Outbox {
    bytes: Vec<u8>,
    start: usize,
    /// Start of some packet, at or before `start`.
    boundary: usize,
}

/// Largest capacity in bytes that an empty outbox keeps.
const KEPT: usize = 1 << 18;

impl Outbox {
    /// Returns the buffer, to append packets.
    pub fn end(&mut self) -> &mut Vec<u8> {
        &mut self.bytes
    }

    /// Returns the unsent bytes.
    pub fn pending(&self) -> &[u8] {
        &self.bytes[self.start..]
    }

    /// Returns the bytes of memory that the outbox holds.
    pub fn capacity(&self) -> usize {
        self.bytes.capacity()
    }

    pub fn len(&self) -> usize {
        self.bytes.len() - self.start
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Removes the first `count` bytes, which were sent.
    pub fn sent(&mut self, count: usize) {
        self.start += count;
        if self.start == self.bytes.len() {
            self.bytes.clear();
            self.start = 0;
            self.boundary = 0;
            self.bytes.shrink_to(KEPT);
        } else if self.start > KEPT && self.start > self.bytes.len() / 2 {
            self.find_boundary();
            self.bytes.drain(..self.boundary);
            self.start -= self.boundary;
            self.boundary = 0;
        }
    }

    /// Drops the waiting packets except the rest of a partly sent one, so that other packets can follow.
    pub fn abandon(&mut self) {
        self.find_boundary();
        let end = if self.boundary == self.start {
            self.start
        } else {
            self.next(self.boundary)
        };
        self.bytes.truncate(end);
        self.bytes.shrink_to_fit();
        self.sent(0);
    }

    /// Moves `boundary` to the start of the packet that contains `start`.
    fn find_boundary(&mut self) {
        while self.boundary < self.start {
            let next = self.next(self.boundary);
            if next > self.start {
                return;
            }
            self.boundary = next;
        }
    }

    /// Returns the end of the packet that begins at `start`.
    fn next(&self, start: usize) -> usize {
        match frame(&self.bytes[start..], usize::MAX) {
            Ok(Some((_, head, body))) => (start + head + body).min(self.bytes.len()),
            _ => self.bytes.len(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn after_abandoning_the_stream_is_still_whole_packets(
            sizes in prop::collection::vec(0usize..60_000, 1..60),
            cuts in prop::collection::vec(1usize..200_000, 0..40),
        ) {
            let mut outbox = Outbox::default();
            let mut stream = Vec::new();
            for size in &sizes {
                let end = outbox.end();
                end.extend([0x30, (size & 0x7f) as u8 | 0x80, (size >> 7 & 0x7f) as u8 | 0x80, (size >> 14) as u8]);
                end.resize(end.len() + size, 7);
            }
            for cut in cuts {
                let sent = cut.min(outbox.len());
                stream.extend_from_slice(&outbox.pending()[..sent]);
                outbox.sent(sent);
            }
            outbox.abandon();
            stream.extend_from_slice(outbox.pending());
            let (mut place, mut count) = (0, 0);
            while let Ok(Some((first, head, body))) = frame(&stream[place..], usize::MAX) {
                prop_assert_eq!((first, body), (0x30, sizes[count]));
                place += head + body;
                count += 1;
            }
            prop_assert_eq!(place, stream.len());
            prop_assert!(outbox.len() < 60_010);
        }
    }
}

//! Tracking of the packets that the broker has read: a ping follows each large packet, and its answer proves that the
//! packet was read.
//!
//! Some brokers close the connection on a packet larger than they accept, without having announced a limit (MQTT 3.1.1
//! has no way to). A packet that was sent but not read when the connection broke may be the cause.

use std::collections::VecDeque;

/// Size in bytes of a packet that every broker accepts.
const SMALL: usize = 1024;

/// Large packets and pings of a connection, in the order of sending.
#[derive(Debug, Default)]
pub(crate) struct Reading {
    /// Size of the largest packet that was read.
    read: usize,
    /// Size of the packet before each unanswered ping; 0 if it is irrelevant.
    asked: VecDeque<usize>,
}

impl Reading {
    /// Records a message sent in a packet of `bytes` bytes. Returns whether a ping must follow, which is rare: only if
    /// the packet is larger than all earlier ones.
    pub fn sent(&mut self, bytes: usize) -> bool {
        bytes > SMALL && bytes > self.read && bytes > self.unread()
    }

    /// Records a ping sent after a packet of `bytes` bytes.
    pub fn asked(&mut self, bytes: usize) {
        self.asked.push_back(bytes);
    }

    /// Records the answer to a ping.
    pub fn answered(&mut self) {
        let bytes = self.asked.pop_front().unwrap_or_default();
        self.read = self.read.max(bytes);
    }

    /// Returns the size of the largest packet above [`SMALL`] that the broker has read; 0 if there is none.
    pub fn read(&self) -> usize {
        self.read
    }

    /// Returns the size of the largest packet that was sent and may not have been read; 0 if none is larger than those
    /// that were read.
    pub fn unread(&self) -> usize {
        self.asked.iter().copied().max().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn send(reading: &mut Reading, bytes: usize) -> bool {
        let asks = reading.sent(bytes);
        if asks {
            reading.asked(bytes);
        }
        asks
    }

    #[test]
    fn only_packets_that_are_larger_than_all_before_are_asked_about() {
        let mut reading = Reading::default();
        assert!(!send(&mut reading, SMALL));
        assert!(send(&mut reading, 5000));
        assert!(!send(&mut reading, 5000));
        assert!(send(&mut reading, 9000));
        assert_eq!((reading.read(), reading.unread()), (0, 9000));
        reading.answered();
        assert_eq!((reading.read(), reading.unread()), (5000, 9000));
        reading.answered();
        assert_eq!((reading.read(), reading.unread()), (9000, 0));
        assert!(!send(&mut reading, 8000));
    }

    #[test]
    fn answers_to_other_pings_prove_nothing() {
        let mut reading = Reading::default();
        reading.asked(0);
        assert!(send(&mut reading, 5000));
        reading.answered();
        assert_eq!((reading.read(), reading.unread()), (0, 5000));
        reading.answered();
        reading.answered();
        assert_eq!((reading.read(), reading.unread()), (5000, 0));
    }
}

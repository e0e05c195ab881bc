//! What the broker is known to have read: a ping follows a large packet, and its answer proves that the broker has
//! read the packet.
//!
//! Some brokers close the connection on a packet that is larger than they accept, without having announced a limit
//! (MQTT 3.1.1 cannot). A packet that was sent and not read when the connection broke may be the cause.

use std::collections::VecDeque;

/// Every broker accepts packets of this size, bytes.
const SMALL: usize = 1024;

/// A connection's packets and pings, in the order in which they were sent.
#[derive(Debug, Default)]
pub(crate) struct Reading {
    /// The largest packet that was read.
    read: usize,
    /// For each ping that is not answered, the packet before it: 0 for one that is of no interest.
    asked: VecDeque<usize>,
}

impl Reading {
    /// Notes a message sent in a packet of `bytes` bytes. Returns whether a ping must follow: only if it is larger than all
    /// before, so pings are few.
    pub fn sent(&mut self, bytes: usize) -> bool {
        bytes > SMALL && bytes > self.read && bytes > self.unread()
    }

    /// Notes a ping sent after a packet of `bytes` bytes.
    pub fn asked(&mut self, bytes: usize) {
        self.asked.push_back(bytes);
    }

    /// A ping was answered.
    pub fn answered(&mut self) {
        let bytes = self.asked.pop_front().unwrap_or_default();
        self.read = self.read.max(bytes);
    }

    /// Bytes of the largest packet that the broker has read, of those above [`SMALL`]; 0 for none.
    pub fn read(&self) -> usize {
        self.read
    }

    /// Bytes of the largest packet that was sent and is not known to have been read; 0 where none is larger than those
    /// that were.
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

//! Connections ended by the broker: because of the client's behaviour, to free memory, or when it stops.

use super::Hub;
use super::complaints::Kind;
use std::time::Instant;
use swarmwright_packets::{Refusal, reason};

impl Hub {
    /// Sends a DISCONNECT to every client because the broker stops.
    pub fn stop(&mut self) {
        let ids: Vec<usize> = self.links.iter().map(|(id, _)| id).collect();
        for id in ids {
            let link = &mut self.links[id];
            if link.session.is_some() && !link.closing {
                let version = link.terms.version;
                swarmwright_packets::disconnect(
                    link.out.end(),
                    reason::SHUTTING_DOWN,
                    "the broker is stopping",
                    version,
                    link.terms.maximum_packet,
                );
            }
            link.closing = true;
            self.mark(id);
        }
    }

    /// Ends a connection because of its client's behaviour; the reason is sent to the client and logged.
    pub(super) fn refuse(&mut self, id: usize, refusal: Refusal, now: Instant) {
        let link = &mut self.links[id];
        if link.closing {
            return;
        }
        match link.session {
            Some(session) => {
                let client = &self.sessions[session].client_id;
                self.complaints.say(Kind::Disconnected, now, || {
                    format!(
                        "client {client} at {}: {}; disconnected",
                        link.peer, refusal.what
                    )
                });
                swarmwright_packets::disconnect(
                    link.out.end(),
                    refusal.reason,
                    refusal.what,
                    link.terms.version,
                    link.terms.maximum_packet,
                );
            }
            None => {
                self.complaints.say(Kind::Refused, now, || {
                    format!("{}: {}; refused", link.peer, refusal.what)
                });
                swarmwright_packets::refuse(
                    link.out.end(),
                    refusal.reason,
                    refusal.what,
                    link.terms.version,
                    link.terms.maximum_packet,
                );
            }
        }
        link.closing = true;
        self.mark(id);
        self.leave(id, true, now);
    }

    /// Disconnects clients that fell too far behind while messages were routed.
    pub(super) fn settle(&mut self, now: Instant) {
        while let Some(id) = self.to_cut_off.pop() {
            if self.links.get(id).is_some_and(|link| !link.closing) {
                self.cut_off(id, "too far behind in reading", now);
            }
        }
    }

    /// Disconnects a client and drops its waiting messages, which would not arrive before the connection ends.
    pub(super) fn cut_off(&mut self, id: usize, explanation: &'static str, now: Instant) {
        let link = &mut self.links[id];
        let behind = link.out.len() + link.buffers;
        self.complaints.say(Kind::Disconnected, now, || {
            format!("{}: {behind} bytes are stored for this client", link.peer)
        });
        link.out.abandon();
        link.lookups.clear();
        // The server frees the buffers when it notices that the connection is closing.
        link.buffers = 0;
        self.recount(id);
        self.refuse(id, Refusal::new(reason::QUOTA_EXCEEDED, explanation), now);
    }
}

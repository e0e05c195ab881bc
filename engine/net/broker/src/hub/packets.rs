//! Packets: framing, decoding and dispatch.

use super::{Hub, WORK_OF_PACKET};
use std::time::Instant;
use swarmwright_packets::{Answer, Packet, Refusal, Version, reason};

/// Largest CONNECT in bytes: client identifier, will, user name and password with 64 KiB each, and properties.
const LARGEST_CONNECT: usize = 1 << 19;

/// Next action after a packet.
pub(super) enum Next {
    /// Process the next packet.
    Packet,
    /// Wait until the password has been checked.
    Verdict,
}

impl Hub {
    /// Processes received bytes; returns the total size of the complete packets among them. The caller keeps the rest,
    /// and passes it again with more bytes appended.
    pub fn receive(&mut self, id: usize, bytes: &[u8], now: Instant) -> usize {
        let mut done = 0;
        let link = &mut self.links[id];
        // Unauthenticated clients cannot gain time by sending small pieces.
        if link.session.is_some() {
            link.heard = now;
        }
        while !self.links[id].closing && self.links[id].asked.is_none() {
            let (first, head, body) = match self.frame(id, &bytes[done..]) {
                Ok(Some(frame)) => frame,
                Ok(None) => return done,
                Err(refusal) => {
                    self.refuse(id, refusal, now);
                    break;
                }
            };
            let start = done + head;
            done = start + body;
            self.links[id].allowance -= 1.0;
            self.work += WORK_OF_PACKET;
            if self.links[id].session.is_none() {
                self.note_version(id, &bytes[start..done]);
            }
            let version = self.links[id].terms.version;
            let outcome = swarmwright_packets::decode(first, &bytes[start..done], version)
                .and_then(|packet| self.handle(id, packet, now));
            match outcome {
                Ok(Next::Packet) => {}
                Ok(Next::Verdict) => {
                    self.links[id].asked = Some(bytes[start..done].into());
                    self.recount(id);
                }
                Err(refusal) => self.refuse(id, refusal, now),
            }
            self.relieve(now);
            self.settle(now);
        }
        if self.links[id].closing {
            bytes.len()
        } else {
            done
        }
    }

    /// Records the protocol version in a CONNECT, so that it can be answered even if the rest is unreadable.
    fn note_version(&mut self, id: usize, connect: &[u8]) {
        if let Some(version) = swarmwright_packets::version_of(connect) {
            self.links[id].terms.version = version;
        }
    }

    /// Returns the header of the first packet in `bytes`, if complete. An unauthenticated client may send only a
    /// CONNECT.
    fn frame(&self, id: usize, bytes: &[u8]) -> Result<Option<(u8, usize, usize)>, Refusal> {
        let is_known = self.links[id].session.is_some();
        if !is_known && bytes.first().is_some_and(|&first| first != 0x10) {
            return Err(Refusal::protocol("the first packet must be CONNECT"));
        }
        let limit = if is_known {
            self.limits.packet
        } else {
            self.limits.packet.min(LARGEST_CONNECT)
        };
        let frame = swarmwright_packets::frame(bytes, limit)?;
        Ok(frame.filter(|(_, head, body)| bytes.len() >= head + body))
    }

    fn handle(&mut self, id: usize, packet: Packet<'_>, now: Instant) -> Result<Next, Refusal> {
        let packet = match packet {
            Packet::Connect(connect) => return self.connect(id, &connect, now),
            other => other,
        };
        let Some(session) = self.links[id].session else {
            return Err(Refusal::protocol("the first packet must be CONNECT"));
        };
        match packet {
            Packet::Connect(_) => {}
            Packet::Publish(publish) => self.published(id, session, &publish, now)?,
            Packet::Acknowledge(kind, packet, code) => {
                self.acknowledged(id, session, kind, packet, code, now)?;
            }
            Packet::Subscribe {
                id: packet,
                identifier,
                filters,
            } => self.subscribe(id, session, packet, identifier, &filters, now)?,
            Packet::Unsubscribe {
                id: packet,
                filters,
            } => self.unsubscribe(id, session, packet, &filters)?,
            Packet::Ping => self.answer(id, |out, _| swarmwright_packets::pingresp(out))?,
            Packet::Disconnect {
                reason,
                session_expiry,
            } => self.disconnected(id, session, reason, session_expiry, now)?,
        }
        Ok(Next::Packet)
    }

    fn acknowledged(
        &mut self,
        id: usize,
        session: usize,
        kind: Answer,
        packet: u16,
        code: u8,
        now: Instant,
    ) -> Result<(), Refusal> {
        let remembered = &mut self.sessions[session];
        if !remembered.expects(packet, kind) {
            return Err(Refusal::protocol(
                "an acknowledgement that does not belong to the QoS of the message",
            ));
        }
        let code_of = |exists| {
            if exists {
                reason::SUCCESS
            } else {
                reason::UNKNOWN_PACKET_ID
            }
        };
        let reply = match kind {
            Answer::Acknowledged | Answer::Complete => {
                remembered.finish(packet);
                None
            }
            Answer::Received if code >= 0x80 => {
                remembered.finish(packet);
                None
            }
            Answer::Received => Some((Answer::Release, code_of(remembered.received(packet)))),
            Answer::Release => Some((
                Answer::Complete,
                code_of(remembered.inbound.remove(&packet)),
            )),
        };
        if let Some((kind, code)) = reply {
            self.answer(id, |out, version| {
                swarmwright_packets::acknowledge(out, kind, packet, code, version);
            })?;
        }
        let link = &mut self.links[id];
        self.sessions[session].advance(&mut link.out, link.terms, now);
        self.mark(id);
        self.recount_session(session);
        Ok(())
    }

    /// Appends an answer to a packet from the client; fails if the client does not accept packets of that size.
    pub(super) fn answer(
        &mut self,
        id: usize,
        write: impl FnOnce(&mut Vec<u8>, Version),
    ) -> Result<(), Refusal> {
        let link = &mut self.links[id];
        let out = link.out.end();
        let before = out.len();
        write(out, link.terms.version);
        let length = out.len() - before;
        if length > link.terms.maximum_packet {
            out.truncate(before);
            return Err(Refusal::new(
                reason::PACKET_TOO_LARGE,
                "an answer is larger than the packets that the client accepts",
            ));
        }
        link.answers += length;
        self.mark(id);
        Ok(())
    }
}

//! Exchanges with the broker without sockets, in virtual time.

mod conformance;
mod delivery;
mod fuzz;
mod limits;
mod refusals;
mod sessions;

use super::*;
use swarmwright_packets::reason;

const CONNACK: u8 = 0x20;
const PUBLISH: u8 = 0x30;
const DISCONNECT: u8 = 0xe0;

/// A hub and a clock that only moves when told.
struct Stage {
    hub: Hub,
    now: Instant,
}

fn text(text: &str) -> Vec<u8> {
    let mut bytes = (text.len() as u16).to_be_bytes().to_vec();
    bytes.extend(text.as_bytes());
    bytes
}

fn packet(first: u8, body: &[u8]) -> Vec<u8> {
    let mut bytes = vec![first];
    let mut length = body.len();
    while length > 0x7f {
        bytes.push((length & 0x7f) as u8 | 0x80);
        length >>= 7;
    }
    bytes.push(length as u8);
    bytes.extend(body);
    bytes
}

/// Encodes a CONNECT of MQTT 5 with properties, and the will as (delay, topic) if there is one.
fn connect(
    id: &str,
    clean: bool,
    keep_alive: u16,
    expiry: u32,
    will: Option<(u32, &str)>,
) -> Vec<u8> {
    let mut body = text("MQTT");
    body.extend([5, u8::from(clean) << 1 | u8::from(will.is_some()) << 2]);
    body.extend(keep_alive.to_be_bytes());
    body.extend([5, 0x11]);
    body.extend(expiry.to_be_bytes());
    body.extend(text(id));
    if let Some((delay, topic)) = will {
        body.extend([5, 0x18]);
        body.extend(delay.to_be_bytes());
        body.extend(text(topic));
        body.extend(text("lost"));
    }
    packet(0x10, &body)
}

fn subscribe(filter: &str, options: u8) -> Vec<u8> {
    let mut body = vec![0, 7, 0];
    body.extend(text(filter));
    body.push(options);
    packet(0x82, &body)
}

fn publish(topic: &str, flags: u8, id: u16, properties: &[u8], payload: &[u8]) -> Vec<u8> {
    let mut body = text(topic);
    if flags & 6 != 0 {
        body.extend(id.to_be_bytes());
    }
    body.push(properties.len() as u8);
    body.extend(properties);
    body.extend(payload);
    packet(PUBLISH | flags, &body)
}

impl Stage {
    fn new(limits: Limits) -> Self {
        Self {
            hub: Hub::new(limits, None, None, None),
            now: Instant::now(),
        }
    }

    /// Opens a connection and sends CONNECT. Returns its number, and whether CONNACK reports an earlier session.
    fn join(&mut self, connect: &[u8]) -> (usize, bool) {
        let link = self.hub.open("test".into(), self.now).unwrap();
        self.hub.receive(link, connect, self.now);
        let answer = self.heard(link);
        assert_eq!((answer[0].0, answer[0].1[1]), (CONNACK, 0), "{answer:?}");
        let present = answer[0].1[0] == 1;
        // Leave the session's messages to the caller.
        for (first, body) in answer.into_iter().skip(1) {
            self.hub.links[link].out.end().extend(packet(first, &body));
        }
        (link, present)
    }

    fn reader(&mut self, id: &str, filter: &str, options: u8) -> usize {
        let (link, _) = self.join(&connect(id, true, 0, 0, None));
        self.say(link, &subscribe(filter, options));
        assert_eq!(self.heard(link)[0].0, 0x90);
        link
    }

    fn say(&mut self, link: usize, bytes: &[u8]) {
        assert_eq!(self.hub.receive(link, bytes, self.now), bytes.len());
    }

    /// Takes everything sent to a connection since the last call: first byte and body of each packet.
    fn heard(&mut self, link: usize) -> Vec<(u8, Vec<u8>)> {
        let pending = self.hub.outbox(link).pending().to_vec();
        self.hub.sent(link, pending.len(), self.now);
        let mut packets = Vec::new();
        let mut rest = &pending[..];
        while let Ok(Some((first, head, body))) = swarmwright_packets::frame(rest, usize::MAX) {
            packets.push((first, rest[head..head + body].to_vec()));
            rest = &rest[head + body..];
        }
        assert!(rest.is_empty());
        packets
    }

    fn pass(&mut self, seconds: u64) {
        self.now += Duration::from_secs(seconds);
        self.hub.tick(self.now);
    }

    fn payloads(&mut self, link: usize) -> Vec<String> {
        let packets = self.heard(link);
        let bodies = packets.iter().filter(|(first, _)| first & 0xf0 == PUBLISH);
        bodies
            .map(|(first, body)| String::from_utf8_lossy(payload(*first, body)).into_owned())
            .collect()
    }
}

/// Returns the payload of a PUBLISH of MQTT 5 whose properties are shorter than 128 bytes.
fn payload(first: u8, body: &[u8]) -> &[u8] {
    let topic = usize::from(u16::from_be_bytes([body[0], body[1]]));
    let properties = 2 + topic + if first & 6 != 0 { 2 } else { 0 };
    &body[properties + 1 + usize::from(body[properties])..]
}

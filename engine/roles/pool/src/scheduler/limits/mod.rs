//! Messages that are too large for a broker that does not announce its limit: it ends the connection.
//!
//! This tool's connection knows what it had sent when it ended. Of a server, the work in progress is known, and that its
//! process continues, as it returns as the same instance. A crashed server does not, so a crash is never mistaken for this.

mod limit;

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use swarmwright_protocol::{MAX_PAYLOAD, Topic, Topics};

use crate::mode::Way;
use crate::scheduler::fleet::slot::Slot;
use crate::scheduler::limits::limit::Limit;
use crate::scheduler::modes::request::Request;

/// Size in bytes of a message that every broker accepts.
const SMALL: usize = 1024;
/// Bytes of a packet beside its topic and payload, at most.
const PACKET_HEADER: usize = 16;
/// Bytes of a packet beside its payload, at most.
const HEADER: usize = 256;
/// A server that was silent for longer when its connection ended had not just sent something.
const RECENT: Duration = Duration::from_secs(30);
/// How long a server may take to come back.
const RETURN_TIMEOUT: Duration = Duration::from_secs(60);
/// Where brokers are told how much to take.
const SETTINGS: &str = "Mosquitto: max_packet_size, rumqttd: max_payload_size, Moquette: netty.mqtt.message_size, EMQX: \
                        mqtt.max_packet_size";

/// What servers send in one message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// A step of episodes.
    Batch,
    /// Results of evaluations.
    Block,
}

/// A server whose connection ended when it may just have sent something large.
#[derive(Debug)]
struct Suspect {
    instance: String,
    kind: Kind,
    /// Episodes of the batch, or evaluations of the block.
    size: usize,
    /// Bytes of its message, where they can be told.
    bytes: Option<usize>,
    at: Instant,
}

/// What is known of how much the broker takes.
#[derive(Debug, Default)]
pub(crate) struct Limits {
    /// Size in bytes of the largest packet that the broker accepts, if announced.
    announced: Option<usize>,
    /// Bytes of a request for blocks of the work beside genomes and seeds.
    beside: usize,
    /// Bytes of this tool's packets.
    packet: Limit,
    /// Episodes of a batch.
    batch: Limit,
    /// Evaluations of a block.
    block: Limit,
    /// Bytes of the message on which a server's connection ended last.
    bytes: Option<usize>,
    /// Bytes of the largest message of the work that cannot be sent in smaller parts.
    whole: usize,
    suspects: BTreeMap<u64, Suspect>,
    /// Whether the user knows.
    told: bool,
    hopeless: Option<String>,
}

impl Limits {
    /// Notes that other work begins. `beside`: bytes of a request for one of its blocks, besides genomes and seeds.
    pub fn begin(&mut self, beside: usize) {
        self.beside = beside;
        self.whole = 0;
        self.hopeless = None;
    }

    /// A message was sent that cannot be smaller.
    pub fn sent_whole(&mut self, bytes: usize) {
        self.whole = self.whole.max(bytes);
    }

    /// So many evaluations of a server's are not to be exceeded where that can be avoided.
    pub fn at_once(&self, way: Way) -> usize {
        let limit = match way {
            Way::Stepwise => return usize::MAX,
            Way::Batched(_) => &self.batch,
            Way::Offloaded => &self.block,
        };
        limit.advice().unwrap_or(usize::MAX)
    }

    pub fn tick(&mut self, now: Instant) {
        for limit in [&mut self.packet, &mut self.batch, &mut self.block] {
            limit.tick(now);
        }
    }

    fn of(&mut self, kind: Kind) -> &mut Limit {
        match kind {
            Kind::Batch => &mut self.batch,
            Kind::Block => &mut self.block,
        }
    }

    /// Whether what was learnt stands for a while.
    fn are_settled(&self) -> bool {
        let limits = [&self.packet, &self.batch, &self.block];
        let learnt = |limit: &&&Limit| limit.advice().is_some();
        limits.iter().filter(learnt).all(|limit| limit.is_settled())
    }

    /// What the user should know, once.
    fn news(&self) -> Option<String> {
        let sizes = |limit: &Limit| Some((limit.broke()?, limit.advice()?));
        let (connection, now) = if let Some((broke, advice)) = sizes(&self.packet) {
            (
                format!("this tool's connection on a packet of {broke} bytes"),
                format!("its packets have {advice} bytes at most from now on"),
            )
        } else if let Some((broke, advice)) = sizes(&self.batch) {
            let bytes = self
                .bytes
                .map_or_else(String::new, |bytes| format!(", some {bytes} bytes"));
            (
                format!("servers' connections on a step of {broke} episodes{bytes}"),
                format!("batches have {advice} episodes at most from now on"),
            )
        } else {
            let (broke, advice) = sizes(&self.block)?;
            (
                format!("servers' connections on the results of {broke} evaluations"),
                format!("servers get {advice} evaluations at most at once from now on"),
            )
        };
        Some(format!(
            "the broker repeatedly ended {connection} without announcing its limit: {now}, which is slower; raise its limit to \
             at least 1 MiB ({SETTINGS})"
        ))
    }
}

/// Why there is no way on.
fn hopeless(connection: &str, size: usize) -> String {
    let note = match size {
        0 => String::new(),
        size => format!(", the largest that it accepted had {size}"),
    };
    format!(
        "the broker ends {connection}, and an evaluation needs that much{note}; raise the broker's limit ({SETTINGS}) and resume \
         the run"
    )
}

/// This tool's packets.
impl Limits {
    /// The broker says that it takes no larger packets.
    pub fn set_packet(&mut self, bytes: usize) {
        self.announced = Some(bytes);
    }

    /// Bytes of the largest packet that the broker takes, as far as it says so.
    pub fn packet(&self) -> usize {
        self.announced.unwrap_or(usize::MAX)
    }

    /// Bytes that a packet of this tool should not exceed.
    pub fn room(&self) -> usize {
        let advice = self.packet.advice();
        advice.map_or(self.packet(), |advice| advice.min(self.packet()))
    }

    /// Bytes of a request for blocks of the work beside genomes and seeds.
    pub fn beside(&self) -> usize {
        self.beside
    }

    /// Notes that the broker has read a packet of `bytes` bytes.
    pub fn was_read(&mut self, bytes: usize) {
        self.packet.took(bytes);
    }

    /// This tool's connection ended, with a packet of so many bytes sent of which it is not known whether the broker read
    /// it.
    pub fn ended_on(&mut self, bytes: usize, now: Instant) {
        let whole = bytes <= self.whole.saturating_add(HEADER);
        self.packet.on_connection_end(bytes, whole, now);
        if self.packet.is_hopeless() {
            let connection =
                format!("the connection of this tool on every packet of {bytes} bytes");
            self.hopeless = Some(hopeless(&connection, self.packet.largest_accepted()));
        }
    }

    /// Reason why a message of `bytes` bytes cannot be sent to a server, if any.
    pub fn too_large(&self, topics: &Topics, topic: Topic, bytes: usize) -> Option<String> {
        let beside = topics.name(topic).len() + PACKET_HEADER;
        let (name, takes) = (topic.name(), self.packet().saturating_sub(beside));
        if bytes > MAX_PAYLOAD {
            Some(format!(
                "a {name} message of {bytes} bytes is larger than the {MAX_PAYLOAD} allowed"
            ))
        } else if bytes > takes {
            Some(format!(
                "a {name} message of {bytes} bytes is larger than the {takes} that the broker accepts"
            ))
        } else {
            None
        }
    }

    /// Why the work cannot be done, however often it is tried: a part of it is larger than the broker takes.
    pub fn hopeless(&self) -> Option<&str> {
        self.hopeless.as_deref()
    }

    /// What was learnt, once, when it stands for a while, or the work is done.
    pub fn take_news(&mut self, done: bool) -> Option<String> {
        if self.told || !(self.are_settled() || done) {
            return None;
        }
        let text = self.news()?;
        self.told = true;
        Some(text)
    }
}

/// Servers' messages.
impl Limits {
    /// A server's connection has ended: perhaps on what it had just sent. `at`: the request that it was at; `results`:
    /// numbers that each evaluation has.
    pub fn suspect(
        &mut self,
        server: u64,
        instance: Option<&str>,
        at: Option<(&Slot, &Request)>,
        results: usize,
        now: Instant,
    ) {
        self.suspects.remove(&server);
        let (Some((slot, request)), Some(instance)) = (at, instance) else {
            return;
        };
        if slot.instance.as_deref() != Some(instance)
            || now.saturating_duration_since(request.heard()) > RECENT
        {
            return;
        }
        let size = request.piece.len();
        let (kind, bytes) = due(request, results);
        // What is not known may be large; of what cannot be smaller it must be known.
        if bytes.map_or(size > 1, |bytes| bytes > SMALL) {
            let suspect = Suspect {
                instance: instance.to_owned(),
                kind,
                size,
                bytes,
                at: now,
            };
            self.suspects.insert(server, suspect);
        }
    }

    /// A server is there. If it is the one whose connection had ended, its process lives. Whether it was not to blame.
    pub fn came_back(&mut self, server: u64, instance: Option<&str>, now: Instant) -> bool {
        let Some(suspect) = self.suspects.remove(&server) else {
            return false;
        };
        if instance != Some(&*suspect.instance)
            || now.saturating_duration_since(suspect.at) > RETURN_TIMEOUT
        {
            return false;
        }
        let limit = self.of(suspect.kind);
        let excused = suspect.size > limit.largest_accepted();
        limit.on_connection_end(suspect.size, suspect.size == 1, now);
        let is_hopeless = limit.is_hopeless();
        self.bytes = suspect.bytes;
        if is_hopeless {
            let bytes = suspect.bytes.unwrap_or_default();
            let connection =
                format!("servers' connections on every message of about {bytes} bytes");
            self.hopeless = Some(hopeless(&connection, 0));
        }
        excused
    }

    /// All of a request went through.
    pub fn went_through(&mut self, request: &Request) {
        let kind = if request.batch.is_some() {
            Kind::Batch
        } else {
            Kind::Block
        };
        self.of(kind).took(request.piece.len());
    }
}

/// Approximate size of a server's next message in bytes; `None` if unknown.
fn due(request: &Request, results: usize) -> (Kind, Option<usize>) {
    let size = request.piece.len();
    let Some(batch) = &request.batch else {
        return (Kind::Block, Some(8 * results * size));
    };
    (Kind::Batch, batch.due(results))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_have_the_size_that_the_protocol_and_the_broker_allow() {
        let topics = Topics::default();
        let mut limits = Limits::default();
        let reason = |limits: &Limits, bytes| limits.too_large(&topics, Topic::Actuator, bytes);
        assert_eq!(reason(&limits, MAX_PAYLOAD), None);
        let told = reason(&limits, MAX_PAYLOAD + 1).unwrap_or_default();
        assert!(told.ends_with(" allowed"), "{told}");
        limits.set_packet(1000);
        let takes = 1000 - topics.name(Topic::Actuator).len() - PACKET_HEADER;
        assert_eq!(reason(&limits, takes), None);
        let told = reason(&limits, takes + 1).unwrap_or_default();
        assert!(
            told.ends_with(&format!("than the {takes} that the broker accepts")),
            "{told}"
        );
    }
}

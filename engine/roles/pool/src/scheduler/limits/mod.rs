//! Message sizes for brokers that do not announce their limit and end the connection on larger messages.
//!
//! For this tool's connection, the sizes sent before it ended are known. For a server's, the work in progress is known,
//! and that its process continues, because it returns as the same instance. A crashed server does not return as the
//! same instance, so a crash is never mistaken for a limit.

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
/// Largest size in bytes of a packet without its topic and payload.
const PACKET_HEADER: usize = 16;
/// Largest size in bytes of a packet without its payload.
const HEADER: usize = 256;
/// Silence of a server before its connection ended above which it has not just sent something.
const RECENT: Duration = Duration::from_secs(30);
/// Time within which a server may return.
const RETURN_TIMEOUT: Duration = Duration::from_secs(60);
/// Names of the settings of common brokers.
const SETTINGS: &str = "Mosquitto: max_packet_size, rumqttd: max_payload_size, Moquette: netty.mqtt.message_size, EMQX: \
                        mqtt.max_packet_size";

/// Kinds of messages that servers send.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// A step of several episodes.
    Batch,
    /// Results of evaluations.
    Block,
}

/// A server whose connection ended when it may just have sent a large message.
#[derive(Debug)]
struct Suspect {
    instance: String,
    kind: Kind,
    /// Number of episodes of the batch, or of evaluations of the block.
    size: usize,
    /// Size of its message in bytes, if known.
    bytes: Option<usize>,
    at: Instant,
}

/// Limits of the broker, announced or learnt.
#[derive(Debug, Default)]
pub(crate) struct Limits {
    /// Size in bytes of the largest packet that the broker accepts, if announced.
    announced: Option<usize>,
    /// Bytes of a request for a block of the work without genomes and seeds.
    beside: usize,
    /// Limit for this tool's packets, in bytes.
    packet: Limit,
    /// Limit for the number of episodes of a batch.
    batch: Limit,
    /// Limit for the number of evaluations of a block.
    block: Limit,
    /// Bytes of the message on which a server's connection last ended.
    bytes: Option<usize>,
    /// Bytes of the largest message of the work that cannot be split.
    whole: usize,
    suspects: BTreeMap<u64, Suspect>,
    /// Whether the user has been told.
    told: bool,
    hopeless: Option<String>,
}

impl Limits {
    /// Prepares for new work. `beside`: bytes of a request for one of its blocks without genomes and seeds.
    pub fn begin(&mut self, beside: usize) {
        self.beside = beside;
        self.whole = 0;
        self.hopeless = None;
    }

    /// Records that a message was sent that cannot be split.
    pub fn sent_whole(&mut self, bytes: usize) {
        self.whole = self.whole.max(bytes);
    }

    /// Returns the number of evaluations of a server to stay within if possible.
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

    /// Returns whether the learnt limits are stable.
    fn are_settled(&self) -> bool {
        let limits = [&self.packet, &self.batch, &self.block];
        let learnt = |limit: &&&Limit| limit.advice().is_some();
        limits.iter().filter(learnt).all(|limit| limit.is_settled())
    }

    /// Returns the warning about the learnt limits, if any.
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

/// Formats the error for work that cannot be done.
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
    /// Sets the largest packet that the broker announces, in bytes.
    pub fn set_packet(&mut self, bytes: usize) {
        self.announced = Some(bytes);
    }

    /// Returns the announced size of the largest packet in bytes; `usize::MAX` if there is none.
    pub fn packet(&self) -> usize {
        self.announced.unwrap_or(usize::MAX)
    }

    /// Returns the size in bytes that a packet of this tool should not exceed.
    pub fn room(&self) -> usize {
        let advice = self.packet.advice();
        advice.map_or(self.packet(), |advice| advice.min(self.packet()))
    }

    /// Returns the bytes of a request for a block of the work without genomes and seeds.
    pub fn beside(&self) -> usize {
        self.beside
    }

    /// Records that the broker has read a packet of `bytes` bytes.
    pub fn was_read(&mut self, bytes: usize) {
        self.packet.took(bytes);
    }

    /// Records that this tool's connection ended after a packet of `bytes` bytes that the broker may not have read.
    pub fn ended_on(&mut self, bytes: usize, now: Instant) {
        let whole = bytes <= self.whole.saturating_add(HEADER);
        self.packet.on_connection_end(bytes, whole, now);
        if self.packet.is_hopeless() {
            let connection =
                format!("the connection of this tool on every packet of {bytes} bytes");
            self.hopeless = Some(hopeless(&connection, self.packet.largest_accepted()));
        }
    }

    /// Returns why a message of `bytes` bytes cannot be sent to a server, if it cannot.
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

    /// Returns why the work can never be done: a part of it is larger than the broker accepts.
    pub fn hopeless(&self) -> Option<&str> {
        self.hopeless.as_deref()
    }

    /// Takes the warning about the learnt limits, given once when they are stable or the work is done.
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
    /// Records that a server's connection ended, perhaps on a message that it had just sent. `at`: its current request;
    /// `results`: numbers per evaluation.
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
        // An unknown size may be large; but a message that cannot be split counts only if its size is known.
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

    /// Records that a server is online. If it is the same instance as before, its process survived. Returns whether the
    /// server was not to blame for the end of its connection.
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

    /// Records that all messages of a request were accepted.
    pub fn went_through(&mut self, request: &Request) {
        let kind = if request.batch.is_some() {
            Kind::Batch
        } else {
            Kind::Block
        };
        self.of(kind).took(request.piece.len());
    }
}

/// Returns the approximate size of a server's next message in bytes; `None` if unknown.
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

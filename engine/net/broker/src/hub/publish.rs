//! Routing of messages from publishers to subscribers: MQTT 5.0, chapters 3.3 and 4.3.

use super::complaints::{Complaints, Kind};
use super::connect::WINDOW;
use super::link::{Link, mark};
use super::memory::recount;
use super::{BEHIND, BYTES_OF_WORK, Hub, STANDSTILL};
use crate::message::Message;
use crate::session::{Delivery, Session};
use std::sync::Arc;
use std::time::Instant;
use swarmwright_packets::topic;
use swarmwright_packets::{
    Answer, Outgoing, Publish, Refusal, Version, acknowledge, publish, reason,
};

/// Largest number of topics whose readers are cached.
const KNOWN_TOPICS: usize = 4096;

/// One reader of a topic, with all its matching subscriptions combined.
pub struct Route {
    session: usize,
    qos: u8,
    /// Whether the client does not receive its own messages (no local).
    no_local: bool,
    retain_as_published: bool,
    identifiers: Box<[u32]>,
}

/// Encodings of one QoS 0 message, each created for the first reader that needs it.
#[derive(Default)]
pub struct Frames {
    bytes: [Vec<u8>; 4],
}

impl Frames {
    fn clear(&mut self) {
        self.bytes.iter_mut().for_each(Vec::clear);
    }

    fn get(&mut self, message: &Publish<'_>, retain: bool, version: Version) -> &[u8] {
        let index = usize::from(retain) + 2 * usize::from(version == Version::Five);
        let bytes = &mut self.bytes[index];
        if bytes.is_empty() {
            publish(bytes, &outgoing(message, retain, &[]), version);
        }
        bytes
    }
}

fn outgoing<'a>(message: &Publish<'a>, retain: bool, identifiers: &'a [u32]) -> Outgoing<'a> {
    Outgoing {
        topic: message.topic,
        payload: message.payload,
        properties: message.properties,
        expiry: None,
        identifiers,
        qos: 0,
        retain,
        again: false,
        id: 0,
    }
}

impl Hub {
    /// Handles a PUBLISH from a client.
    pub(super) fn published(
        &mut self,
        id: usize,
        session: usize,
        message: &Publish<'_>,
        now: Instant,
    ) -> Result<(), Refusal> {
        if !topic::is_name(message.topic) {
            return Err(Refusal::malformed("a topic that cannot be published to"));
        }
        if message.qos == 2 && !self.sessions[session].inbound.insert(message.id) {
            return self.answer_publish(id, message, reason::SUCCESS);
        }
        if self.sessions[session].inbound.len() > usize::from(WINDOW) {
            return Err(Refusal::new(
                reason::RECEIVE_MAXIMUM,
                "more messages in flight than the receive maximum",
            ));
        }
        let code = if self.may_write(session, message.topic) {
            self.route(Some(id), Some(session), message, None, now)
        } else {
            let complaint = format_args!("may not publish to {}", message.topic);
            self.complain(Kind::Denied, session, now, complaint);
            reason::NOT_AUTHORIZED
        };
        if code >= 0x80 && message.qos == 2 {
            self.sessions[session].inbound.remove(&message.id);
        }
        self.answer_publish(id, message, code)
    }

    fn answer_publish(
        &mut self,
        id: usize,
        message: &Publish<'_>,
        code: u8,
    ) -> Result<(), Refusal> {
        let kind = match message.qos {
            0 => return Ok(()),
            1 => Answer::Acknowledged,
            _ => Answer::Received,
        };
        self.answer(id, |out, version| {
            acknowledge(out, kind, message.id, code, version);
        })
    }

    /// Publishes the will of a session.
    pub(super) fn route_will(&mut self, session: usize, will: Message, now: Instant) {
        if !self.may_write(session, &will.topic) {
            return;
        }
        let will = Arc::new(will);
        // The properties do not include the expiry; readers with QoS 0 get the message now and do not need it.
        let message = Publish {
            topic: &will.topic,
            payload: &will.payload,
            properties: &will.properties,
            qos: will.qos,
            retain: will.retain,
            id: 0,
        };
        self.route(None, Some(session), &message, Some(&will), now);
    }

    /// Sends a message to all subscribers, and stores it if it is retained. Returns the reason code for the publisher.
    /// `stored` is the same message, if it has been stored before.
    fn route(
        &mut self,
        from_link: Option<usize>,
        from: Option<usize>,
        message: &Publish<'_>,
        stored: Option<&Arc<Message>>,
        now: Instant,
    ) -> u8 {
        let mut stored = stored.cloned();
        let mut keep =
            || Arc::clone(stored.get_or_insert_with(|| Arc::new(Message::new(message, now))));
        let mut code = reason::NO_MATCHING_SUBSCRIBERS;
        let mut is_kept = message.retain;
        if message.retain {
            code = reason::SUCCESS;
            if !self.retained.set(&keep()) {
                self.complaints.say(Kind::Full, now, || {
                    format!(
                        "{}: not retained, the store for retained messages is full",
                        message.topic
                    )
                });
                code = reason::QUOTA_EXCEEDED;
            }
        }
        let routes = self.routes_of(message.topic);
        self.frames.clear();
        let backlog = self.limits.backlog;
        for route in routes
            .iter()
            .filter(|route| !route.no_local || from != Some(route.session))
        {
            if code == reason::NO_MATCHING_SUBSCRIBERS {
                code = reason::SUCCESS;
            }
            self.work += 1 + message.payload.len() / BYTES_OF_WORK;
            let session = &mut self.sessions[route.session];
            let waiting = session.link.and_then(|id| self.links.get(id));
            is_kept |= waiting.is_none_or(|link| link.out.len() > BEHIND);
            is_kept |= session.queued_bytes() > BEHIND;
            let retain = message.retain && route.retain_as_published;
            let qos = message.qos.min(route.qos);
            let link = session
                .link
                .and_then(|id| Some((id, self.links.get_mut(id)?)));
            let fits = match (qos, link) {
                (0, None) => continue,
                (0, Some((id, link))) => {
                    push(
                        link,
                        &mut self.frames,
                        message,
                        retain,
                        &route.identifiers,
                        now,
                    );
                    mark(link, id, &mut self.dirty);
                    recount(link, &mut self.used);
                    link.out.len() <= backlog
                }
                (_, link) => {
                    let identifiers = route.identifiers.clone();
                    let fits = session.enqueue(
                        Delivery {
                            message: keep(),
                            qos,
                            retain,
                            identifiers,
                        },
                        backlog,
                    );
                    if let Some((id, link)) = link {
                        note_progress(link, now);
                        session.advance(&mut link.out, link.terms, now);
                        mark(link, id, &mut self.dirty);
                        recount(link, &mut self.used);
                    }
                    let size = session.size();
                    self.used = self.used + size - std::mem::replace(&mut session.counted, size);
                    fits
                }
            };
            let reader = session.link;
            if !fits {
                overflow(session, &mut self.to_cut_off, &mut self.complaints, now);
            } else if let (Some(reader), Some(publisher)) = (reader, from_link)
                && reader != publisher
                && self.links[reader].out.len() > backlog / 2
                && now.saturating_duration_since(self.links[reader].progress) < STANDSTILL
            {
                self.links[publisher].held_by = Some(reader);
            }
        }
        if is_kept && let Some(publisher) = from_link {
            self.links[publisher].filled = Some(now);
        }
        code
    }

    fn routes_of(&mut self, name: &str) -> Arc<[Route]> {
        if let Some(cached) = self.routes.get(name) {
            return Arc::clone(cached);
        }
        let subscriptions = self.subscriptions.covering(name);
        let mut routes = Vec::new();
        for of_one in subscriptions.chunk_by(|left, next| left.0 == next.0) {
            let session = of_one[0].0;
            if !self.may_read(session, name) {
                continue;
            }
            let options = || of_one.iter().map(|(_, options)| options);
            routes.push(Route {
                session,
                qos: options().map(|it| it.qos).max().unwrap_or(0),
                no_local: options().all(|it| it.no_local),
                retain_as_published: options().any(|it| it.retain_as_published),
                identifiers: options().filter_map(|it| it.identifier).collect(),
            });
        }
        if self.routes.len() >= KNOWN_TOPICS {
            self.routes.clear();
        }
        let routes: Arc<[Route]> = routes.into();
        self.routes.insert(name.into(), Arc::clone(&routes));
        routes
    }

    pub(super) fn may_read(&self, session: usize, name: &str) -> bool {
        self.access
            .as_ref()
            .is_none_or(|access| access.may_read(self.sessions[session].subject(), name))
    }

    fn may_write(&self, session: usize, name: &str) -> bool {
        self.access
            .as_ref()
            .is_none_or(|access| access.may_write(self.sessions[session].subject(), name))
    }
}

/// Appends a QoS 0 message to a reader's outbox, unless it is larger than the reader accepts.
fn push(
    link: &mut Link,
    frames: &mut Frames,
    message: &Publish<'_>,
    retain: bool,
    identifiers: &[u32],
    now: Instant,
) {
    note_progress(link, now);
    let version = link.terms.version;
    if identifiers.is_empty() {
        let frame = frames.get(message, retain, version);
        if frame.len() <= link.terms.maximum_packet {
            link.out.end().extend_from_slice(frame);
        }
        return;
    }
    let start = link.out.end().len();
    publish(
        link.out.end(),
        &outgoing(message, retain, identifiers),
        version,
    );
    if link.out.end().len() - start > link.terms.maximum_packet {
        link.out.end().truncate(start);
    }
}

/// Counts a reader with an empty outbox as active.
fn note_progress(link: &mut Link, now: Instant) {
    if link.out.is_empty() {
        link.progress = now;
    }
}

/// Handles a full queue: a connected reader is disconnected; for a disconnected one, the newest messages are dropped,
/// which is logged once.
fn overflow(
    session: &mut Session,
    to_cut_off: &mut Vec<usize>,
    complaints: &mut Complaints,
    now: Instant,
) {
    match session.link {
        Some(id) => to_cut_off.push(id),
        None if !session.overflowed => {
            session.overflowed = true;
            let client = &session.client_id;
            complaints.say(Kind::Full, now, || {
                format!(
                    "client {client} is disconnected and its queue is full; messages are dropped"
                )
            });
        }
        None => {}
    }
}

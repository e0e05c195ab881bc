//! Start and end of connections and sessions: MQTT 5.0, chapters 3.1, 3.14 and 4.1.

use super::Hub;
use super::packets::Next;
use crate::message::Message;
use crate::session::{Session, Terms, Testament};
use std::time::{Duration, Instant};
use swarmwright_packets::topic;
use swarmwright_packets::{Connect, Publish, Refusal, Version, Welcome, connack, reason};

/// Largest number of unacknowledged QoS 1 and 2 messages in one direction of a connection.
pub const WINDOW: u16 = 1024;

impl Hub {
    pub(super) fn connect(
        &mut self,
        id: usize,
        connect: &Connect<'_>,
        now: Instant,
    ) -> Result<Next, Refusal> {
        let link = &mut self.links[id];
        if link.session.is_some() {
            return Err(Refusal::protocol("a second CONNECT"));
        }
        link.terms = Terms {
            version: connect.version,
            window: connect.receive_maximum.min(WINDOW),
            maximum_packet: connect.maximum_packet as usize,
        };
        if !self.admit(id, connect, now)? {
            return Ok(Next::Verdict);
        }
        self.enter(id, connect, now)?;
        Ok(Next::Packet)
    }

    /// Accepts a client.
    pub(super) fn enter(
        &mut self,
        id: usize,
        connect: &Connect<'_>,
        now: Instant,
    ) -> Result<(), Refusal> {
        if let Some(will) = &connect.will
            && !topic::is_name(will.topic)
        {
            return Err(Refusal::malformed(
                "the will has a topic that cannot be published to",
            ));
        }
        let assigned = self.client_id(connect)?;
        let client_id = assigned.as_deref().unwrap_or(connect.client_id);
        let longest = u32::try_from(self.limits.session.as_secs()).unwrap_or(u32::MAX);
        let expiry = connect.session_expiry.min(longest);
        let welcome = Welcome {
            assigned_id: assigned.as_deref(),
            session_expiry: (expiry != connect.session_expiry).then_some(expiry),
            receive_maximum: WINDOW,
            maximum_packet: u32::try_from(self.limits.packet).unwrap_or(u32::MAX),
        };
        let version = connect.version;
        if connack(version, false, &welcome).len() > connect.maximum_packet as usize {
            return Err(Refusal::new(
                reason::PACKET_TOO_LARGE,
                "the client accepts no packets of the size of the answer to its CONNECT",
            ));
        }
        let (session, present) = self.session_for(client_id, connect, now);

        let link = &mut self.links[id];
        link.session = Some(session);
        if std::mem::take(&mut link.is_unauthenticated) {
            self.unauthenticated -= 1;
        }
        link.heard = now;
        // One and a half times the announced interval: MQTT 5.0, 3.1.2.10.
        link.keep_alive = (connect.keep_alive > 0)
            .then(|| Duration::from_secs(connect.keep_alive.into()) * 3 / 2);
        let remembered = &mut self.sessions[session];
        if present {
            self.absent -= 1;
        }
        remembered.link = Some(id);
        remembered.expiry = expiry;
        remembered.ends = None;
        remembered.will_due = None;
        remembered.will = connect.will.as_ref().map(|will| Testament {
            delay: will.delay,
            expiry: swarmwright_packets::expiry_of(&will.properties),
            message: Message::new(
                &Publish {
                    topic: will.topic,
                    payload: will.payload,
                    properties: &will.properties,
                    qos: will.qos,
                    retain: will.retain,
                    id: 0,
                },
                now,
            ),
        });
        link.out.end().extend(connack(version, present, &welcome));
        remembered.resume(&mut link.out, link.terms, now);
        log::debug!("client {client_id} at {} connected", link.peer);
        self.mark(id);
        self.recount_session(session);
        Ok(())
    }

    /// Assigns an identifier to a client that sent none; `None` if it sent one.
    fn client_id(&mut self, connect: &Connect<'_>) -> Result<Option<String>, Refusal> {
        if !connect.client_id.is_empty() {
            return Ok(None);
        }
        if connect.version == Version::Three && !connect.clean {
            return Err(Refusal::new(
                reason::BAD_CLIENT_ID,
                "a session that outlives its connection needs a client identifier",
            ));
        }
        loop {
            self.assigned += 1;
            let id = format!("auto-{}", self.assigned);
            if !self.by_client.contains_key(id.as_str()) {
                return Ok(Some(id));
            }
        }
    }

    /// Returns the session to continue, and whether it existed before. Ends an earlier connection with this identifier.
    fn session_for(
        &mut self,
        client_id: &str,
        connect: &Connect<'_>,
        now: Instant,
    ) -> (usize, bool) {
        if let Some(&existing) = self.by_client.get(client_id)
            && let Some(earlier) = self.sessions[existing].link
        {
            let explanation = "another client connected with this client identifier";
            self.refuse(earlier, Refusal::new(reason::TAKEN_OVER, explanation), now);
        }
        // Ending the connection may have ended the session.
        if let Some(&existing) = self.by_client.get(client_id) {
            let same_user = self.sessions[existing].user.as_deref() == connect.user;
            if !connect.clean && same_user {
                return (existing, true);
            }
            self.end_session(existing, now);
        }
        let session = self.sessions.insert(Session::new(client_id, connect.user));
        self.by_client.insert(client_id.into(), session);
        (session, false)
    }

    pub(super) fn disconnected(
        &mut self,
        id: usize,
        session: usize,
        code: u8,
        session_expiry: Option<u32>,
        now: Instant,
    ) -> Result<(), Refusal> {
        let remembered = &mut self.sessions[session];
        if let Some(seconds) = session_expiry {
            if remembered.expiry == 0 && seconds > 0 {
                return Err(Refusal::protocol(
                    "a session without expiry interval cannot be given one at its end",
                ));
            }
            remembered.expiry =
                seconds.min(u32::try_from(self.limits.session.as_secs()).unwrap_or(u32::MAX));
        }
        self.links[id].closing = true;
        self.mark(id);
        self.leave(id, code != reason::SUCCESS, now);
        Ok(())
    }

    /// Detaches a connection from its session; `with_will`: publish the will, at once or after its delay.
    pub(super) fn leave(&mut self, id: usize, with_will: bool, now: Instant) {
        let Some(session) = self.links[id].session.take() else {
            return;
        };
        let remembered = &mut self.sessions[session];
        remembered.link = None;
        remembered.left = Some(now);
        self.absent += 1;
        if !with_will {
            remembered.will = None;
        }
        if remembered.expiry == 0 {
            self.end_session(session, now);
            return;
        }
        remembered.ends = Some(now + Duration::from_secs(remembered.expiry.into()));
        if let Some(will) = &remembered.will {
            remembered.will_due = Some(now + Duration::from_secs(will.delay.into()));
            if will.delay == 0 {
                self.publish_will(session, now);
            }
        }
    }

    pub(super) fn expire_sessions(&mut self, now: Instant) {
        let is_due = |due: Option<Instant>| due.is_some_and(|due| due <= now);
        let due: Vec<usize> = self
            .sessions
            .iter()
            .filter(|(_, session)| is_due(session.ends) || is_due(session.will_due))
            .map(|(id, _)| id)
            .collect();
        for id in due {
            if is_due(self.sessions[id].ends) {
                self.end_session(id, now);
            } else {
                self.publish_will(id, now);
            }
        }
    }

    /// Ends a session, publishing its will if that has not been done.
    pub(super) fn end_session(&mut self, session: usize, now: Instant) {
        self.publish_will(session, now);
        let ended = self.sessions.remove(session);
        if ended.link.is_none() {
            self.absent -= 1;
        }
        self.used -= ended.counted;
        self.by_client.remove(&ended.client_id);
        for filter in ended.filters() {
            self.subscriptions.remove(session, filter);
        }
        self.routes.clear();
    }

    fn publish_will(&mut self, session: usize, now: Instant) {
        self.sessions[session].will_due = None;
        let Some(mut will) = self.sessions[session].will.take() else {
            return;
        };
        // The expiry interval starts with the publication.
        will.message.expires = will
            .expiry
            .map(|seconds| now + Duration::from_secs(seconds.into()));
        self.route_will(session, will.message, now);
    }
}

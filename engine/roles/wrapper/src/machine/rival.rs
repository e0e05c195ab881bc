//! Conflicts with another server that has the same id; one of the two leaves.
//!
//! While a server is offline because its machine is suspended or its connection is cut, another one may take its id.
//! After a reconnection, it therefore does nothing for a moment, and leaves if it receives the presence of another
//! instance with the id. If that presence is only retained by the broker, it publishes that it is lost itself, which a
//! living rival contradicts. Two servers that reconnect at the same time, as after a restart of the broker, notice each
//! other once both are at work: the one whose instance is the greater text leaves, and the other one repeats its
//! presence. For the decision see [docs/decisions/004](../../../../../docs/decisions/004-presence-and-reservation.md).

use std::time::{Duration, Instant};

use swarmwright_protocol::{Presence, Refusal, RefusalKind, State as PresenceState, Topic};

use super::{Machine, SETTLE};
use crate::notice::{Action, Rival};

/// How long a reconnected server listens for another one with its id.
const LISTEN: Duration = Duration::from_millis(100);
/// How long it waits for another server whose presence is only retained to contradict; a restarted broker may retain
/// the presence of servers that are long gone.
const SPEAK_UP: Duration = Duration::from_secs(1);
/// Largest number of messages kept in the meantime.
const KEPT: usize = 1000;

/// A message that is handled later: topic and payload.
type Unheard = (String, Vec<u8>);

/// State of a server that does not know whether its id is still its own.
#[derive(Debug)]
pub(super) struct Listening {
    until: Instant,
    /// Time of the connection, in RFC 3339.
    since: String,
    /// Whether another server has been asked to contradict.
    asked: bool,
    unheard: Vec<Unheard>,
}

/// Another server that has the id and keeps it.
#[derive(Debug)]
pub(super) struct Leaving {
    rival: Rival,
    instance: Option<String>,
    /// Until when the other server may prove to have ended.
    until: Instant,
}

impl Listening {
    pub fn until(&self) -> Instant {
        self.until
    }
}

impl Machine {
    /// Declares that no other server can have this id, so that there is no need to listen for one.
    pub fn set_alone(&mut self) {
        self.alone = true;
    }

    /// Handles a restored connection. The last will has replaced the presence, which is published again once it is
    /// known that no other server has the id. `stamp` is the current time in RFC 3339.
    pub fn connected(&mut self, stamp: String, now: Instant) {
        self.offline = false;
        if self.alone {
            return self.publish_presence(stamp);
        }
        self.listening = Some(Listening {
            until: now + LISTEN,
            since: stamp,
            asked: false,
            unheard: Vec::new(),
        });
    }

    /// Keeps a message for later while it is unknown whether this server still has its id. Returns whether the message
    /// is not to be handled now.
    pub(super) fn hears_later(
        &mut self,
        topic: Topic,
        name: &str,
        payload: &[u8],
        retained: bool,
    ) -> bool {
        let Some(listening) = &mut self.listening else {
            return false;
        };
        // Presence is handled at once; actuators belong to no current run; retained messages are remnants.
        let now = topic == Topic::Presence && !payload.is_empty();
        if matches!(topic, Topic::Presence | Topic::Actuator) || retained {
            return !now;
        }
        if listening.unheard.len() < KEPT {
            listening.unheard.push((name.to_owned(), payload.to_vec()));
        }
        true
    }

    /// Returns whether the listening period has ended without another server.
    pub(super) fn has_listened(&self, now: Instant) -> bool {
        self.listening
            .as_ref()
            .is_some_and(|period| period.until <= now)
    }

    /// Handles the messages that were kept.
    pub(super) fn catch_up(&mut self, now: Instant) {
        let Some(Listening { unheard, .. }) = self.listening.take() else {
            return;
        };
        for (topic, payload) in unheard {
            self.receive(&topic, &payload, false, now);
        }
    }

    /// Returns whether a message is meant for this instance. Most third-party tools name no instance.
    pub(super) fn is_meant(&self, instance: Option<&String>) -> bool {
        instance.is_none_or(|instance| *instance == self.identity.instance)
    }

    /// Returns the refusal of a request for another instance with this id; `None` to ignore the request. It is refused
    /// only if this instance could serve the tool, in case the other instance has ended.
    pub(super) fn refuse_for_another(&self, simulation: &str) -> Option<Refusal> {
        (self.is_free() && self.offered(simulation).is_ok()).then(|| Refusal {
            kind: RefusalKind::Taken,
            reason: "it is meant for another server with this id".to_owned(),
        })
    }

    /// Handles the presence of a server with this id, published now or retained by the broker (`retained`).
    pub(super) fn other_presence(&mut self, presence: &Presence, retained: bool, now: Instant) {
        let other = presence.capabilities.swarmwright.as_ref();
        let instance = other.and_then(|other| other.instance.as_ref());
        if presence.server != self.identity.id {
            return;
        }
        if instance == Some(&self.identity.instance) {
            // The last will of an earlier connection arrived late, and tools would not use this server any more. While
            // listening, the server publishes this state itself.
            if presence.state == PresenceState::Lost && self.listening.is_none() {
                self.say_again(now);
            }
            return;
        }
        if presence.state == PresenceState::Lost {
            self.leaving = self
                .leaving
                .take()
                .filter(|leaving| leaving.instance != instance.cloned());
            // Another server with this id has ended, and its last will has replaced the presence of this one.
            return self.say_again(now);
        }
        let rival = Rival {
            id: self.identity.id,
            host: other.and_then(|other| other.host.clone()),
            pid: other.and_then(|other| other.pid),
        };
        if self.alone {
            return;
        }
        if let Some(listening) = &mut self.listening {
            if !retained {
                return self.actions.push(Action::GiveWay(rival));
            }
            // A living server contradicts this message.
            if !std::mem::replace(&mut listening.asked, true) {
                listening.until = now + SPEAK_UP;
                let since = listening.since.clone();
                let lost = self.presence(PresenceState::Lost, since).encode();
                self.actions.push(Action::Publish(Topic::Presence, lost));
            }
            return;
        }
        self.leaving = None;
        if instance.is_some_and(|instance| *instance < self.identity.instance) {
            // A late message may come from a server that has ended; its last will would follow immediately.
            self.leaving = Some(Leaving {
                rival,
                instance: instance.cloned(),
                until: now + LISTEN,
            });
            return;
        }
        let text = format!(
            "another server has the id {} too ({rival}); give one of them another --id",
            self.identity.id
        );
        if self.rivals.make(&text, now) {
            self.warn(text);
        }
        self.say_again(now);
    }

    pub(super) fn next_leaving(&self) -> Option<Instant> {
        self.leaving.as_ref().map(|leaving| leaving.until)
    }

    /// Leaves when the time has come.
    pub(super) fn leave_to_rival(&mut self, now: Instant) {
        if let Some(leaving) = self.leaving.take_if(|leaving| leaving.until <= now) {
            self.actions.push(Action::GiveWay(leaving.rival));
        }
    }

    /// Repeats the presence at once, since another server's may have replaced it.
    fn say_again(&mut self, now: Instant) {
        self.published = None;
        self.changed_at = Some(now.checked_sub(SETTLE).unwrap_or(now));
    }
}

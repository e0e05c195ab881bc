//! Another server with the same id: one of the two goes.
//!
//! A server that was away, since its machine slept or its connection was cut, may find that another one has its id by now.
//! So it does nothing for a moment when the connection is there again; where it hears the presence of another start of
//! the id, it goes. Where only the broker remembers that presence, it says that it is lost itself, which another one that
//! lives contradicts. Two that come back at once, as after a restart of the broker, hear of each other when
//! both are at work again: the one whose instance is the greater text goes, and the other one says that it is there.
//! Decided here: [docs/decisions/004](../../../../../docs/decisions/004-presence-and-reservation.md).

use std::time::{Duration, Instant};

use swarmwright_protocol::{Presence, Refusal, RefusalKind, State as PresenceState, Topic};

use super::{Machine, SETTLE};
use crate::notice::{Action, Rival};

/// For how long a server whose connection has come back listens for another one with its id.
const LISTEN: Duration = Duration::from_millis(100);
/// For how long it waits for another one of which only the broker has said something to speak up itself: a broker that
/// was restarted may have presence of servers that are long gone.
const SPEAK_UP: Duration = Duration::from_secs(1);
/// Messages that are kept meanwhile.
const KEPT: usize = 1000;

/// A message that is heard later: topic, payload.
type Unheard = (String, Vec<u8>);

/// What a server keeps for later while it does not know whether the id is still its own.
#[derive(Debug)]
pub(super) struct Listening {
    until: Instant,
    /// When it was connected, in RFC 3339.
    since: String,
    /// Whether another one was asked to speak up.
    asked: bool,
    unheard: Vec<Unheard>,
}

/// Another server has the id, and is to keep it.
#[derive(Debug)]
pub(super) struct Leaving {
    rival: Rival,
    instance: Option<String>,
    /// Time until which it may prove to have ended.
    until: Instant,
}

impl Listening {
    pub fn until(&self) -> Instant {
        self.until
    }
}

impl Machine {
    /// No other server can have this id: it need not listen for one.
    pub fn set_alone(&mut self) {
        self.alone = true;
    }

    /// The connection is there again. Presence, in whose place the last will stands, is said when it is known that no
    /// other server has the id. `stamp` is now in RFC 3339.
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

    /// Keeps a message for later while it is not known whether this server still has its id. Whether that is so.
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
        // Of presence nothing is missed; steps belong to nothing that is under way; what is retained is a leftover.
        let now = topic == Topic::Presence && !payload.is_empty();
        if matches!(topic, Topic::Presence | Topic::Actuator) || retained {
            return !now;
        }
        if listening.unheard.len() < KEPT {
            listening.unheard.push((name.to_owned(), payload.to_vec()));
        }
        true
    }

    /// Whether it is known now that no other server has the id.
    pub(super) fn has_listened(&self, now: Instant) -> bool {
        self.listening
            .as_ref()
            .is_some_and(|period| period.until <= now)
    }

    /// Handles the messages that arrived meanwhile.
    pub(super) fn catch_up(&mut self, now: Instant) {
        let Some(Listening { unheard, .. }) = self.listening.take() else {
            return;
        };
        for (topic, payload) in unheard {
            self.receive(&topic, &payload, false, now);
        }
    }

    /// Whether a message for a start of this id is for this one. Most tools of others do not say which one they mean.
    pub(super) fn is_meant(&self, instance: Option<&String>) -> bool {
        instance.is_none_or(|instance| *instance == self.identity.instance)
    }

    /// What is said to a request for another start of a server with this id: nothing, unless that one may be gone and
    /// this one could be asked in its place.
    pub(super) fn refuse_for_another(&self, simulation: &str) -> Option<Refusal> {
        (self.is_free() && self.offered(simulation).is_ok()).then(|| Refusal {
            kind: RefusalKind::Taken,
            reason: "it is meant for another server with this id".to_owned(),
        })
    }

    /// Presence of a server with this id, as it was said or (`retained`) as the broker remembers it.
    pub(super) fn other_presence(&mut self, presence: &Presence, retained: bool, now: Instant) {
        let other = presence.capabilities.swarmwright.as_ref();
        let instance = other.and_then(|other| other.instance.as_ref());
        if presence.server != self.identity.id {
            return;
        }
        if instance == Some(&self.identity.instance) {
            // The last will of an earlier connection, which came late: no tool would use this server any more. What it says
            // while it listens is its own word.
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
            // Another server with this id is gone, and its last will has replaced the presence of this one.
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
            // One that is there answers to this that it is.
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
            // What comes late may be of one that is gone by now: that would come right behind it.
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

    /// Leaves when it is time to.
    pub(super) fn leave_to_rival(&mut self, now: Instant) {
        if let Some(leaving) = self.leaving.take_if(|leaving| leaving.until <= now) {
            self.actions.push(Action::GiveWay(leaving.rival));
        }
    }

    /// What is known of this server may be another one's word: says its presence again, now.
    fn say_again(&mut self, now: Instant) {
        self.published = None;
        self.changed_at = Some(now.checked_sub(SETTLE).unwrap_or(now));
    }
}

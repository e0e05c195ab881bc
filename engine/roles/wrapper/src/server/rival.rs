//! Detection of another server with the same id at the start.

use std::time::{Duration, Instant};

use swarmwright_mqtt::{Connection, Event};
use swarmwright_protocol::{Message, State, Topic, Topics};

use super::ServeError;
use crate::notice::Rival;
use crate::{Identity, identity};

/// How long a starting server listens for another one with its id.
const LISTEN: Duration = Duration::from_millis(100);

/// Listens for the presence of a living server with the same id. Returns the other events that arrived in the meantime.
pub(super) fn find_rival(
    connection: &mut Connection,
    topics: &Topics,
    identity: &Identity,
) -> Result<Vec<Event>, ServeError> {
    let deadline = Instant::now() + LISTEN;
    let mut events = Vec::new();
    let mut early = Vec::new();
    while Instant::now() < deadline {
        connection.poll(deadline, &mut events);
        for event in events.drain(..) {
            let Event::Message(message) = event else {
                continue;
            };
            if topics.parse(message.topic()) != Some(Topic::Presence) {
                early.push(Event::Message(message));
                continue;
            }
            let Ok(Message::Presence(presence)) =
                Message::decode(Topic::Presence, message.payload())
            else {
                continue;
            };
            let other = presence.capabilities.swarmwright.unwrap_or_default();
            let gone = identity::is_dead(other.host.as_deref(), other.pid);
            if presence.server == identity.id && presence.state != State::Lost && !gone {
                let rival = Rival {
                    id: identity.id,
                    host: other.host,
                    pid: other.pid,
                };
                return Err(ServeError::IdTaken {
                    id: identity.id,
                    location: rival.to_string(),
                    topic: topics.presence(identity.id),
                });
            }
        }
    }
    Ok(early)
}

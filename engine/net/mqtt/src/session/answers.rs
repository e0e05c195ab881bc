//! Answers of the broker, and the limits that it announces.

use std::time::{Duration, Instant};

use swarmwright_packets::client::{Connack, Packet};
use swarmwright_packets::{Refusal, disconnect, reason};

use super::{Granted, Limits, MOST_AWAITED, MOST_UNACKNOWLEDGED, QoS, Received, Session, Stage};
use crate::dialect::Remedy;

/// Largest number of characters repeated from a broker's reason.
const LONGEST_TEXT: usize = 200;

pub(super) const NO_CONNACK: Refusal = Refusal::protocol("the answer to CONNECT is not a CONNACK");

impl Session {
    /// Handles a packet other than a message.
    pub(super) fn handle(
        &mut self,
        packet: &Packet<'_>,
        received: &mut impl FnMut(Received),
    ) -> Result<(), Refusal> {
        match (packet, self.stage) {
            (Packet::Connack(connack), Stage::Connecting) => received(self.answered(connack)),
            (Packet::Connack(_), _) => return Err(Refusal::protocol("a second CONNACK")),
            // Brokers may not send it before CONNACK, but it is more informative than the closed connection.
            (Packet::Disconnect { code, text }, _) => {
                self.stage = Stage::Over;
                let reason = match code {
                    0 => "the broker disconnected".to_owned(),
                    _ => format!("the broker disconnected: {}", describe(*code, *text)),
                };
                received(Received::Closed(reason));
            }
            (_, Stage::Connecting) => return Err(NO_CONNACK),
            (Packet::Puback { id, code, text }, _) => {
                let Some(topic) = self.unacknowledged.remove(id) else {
                    return Err(Refusal::protocol("a PUBACK for an unknown message"));
                };
                if *code == reason::NOT_AUTHORIZED {
                    received(Received::Denied(topic.into(), describe(*code, *text)));
                } else if *code >= reason::UNSPECIFIED {
                    // The cause may be temporary, such as an exhausted quota.
                    let reason = describe(*code, *text);
                    log::warn!("{topic:?}: the broker did not distribute a message ({reason})");
                }
            }
            (Packet::Suback { id, codes, text }, _) => {
                if self.subscribing.take() != Some((*id, codes.len())) {
                    return Err(Refusal::protocol(
                        "a SUBACK that does not match the SUBSCRIBE",
                    ));
                }
                let granted = codes.iter().map(|&code| {
                    if code < reason::UNSPECIFIED {
                        Granted::Yes
                    } else {
                        Granted::No(describe(code, *text))
                    }
                });
                received(Received::Subscribed(granted.collect()));
            }
            (Packet::Pong, _) => self.reading.answered(),
            // Messages are handled in `receive_packets`.
            (Packet::Publish(_), _) => {}
        }
        Ok(())
    }

    /// Handles the broker's answer to CONNECT.
    fn answered(&mut self, connack: &Connack<'_>) -> Received {
        if connack.code != reason::SUCCESS {
            self.stage = Stage::Over;
            let remedy = match connack.code {
                reason::UNSUPPORTED_VERSION => Remedy::Older,
                reason::QOS_NOT_SUPPORTED => Remedy::WillAtMostOnce,
                reason::NO_RETAIN => Remedy::WillNotRetained,
                reason::UNAVAILABLE | reason::BUSY | reason::CONNECTION_RATE => Remedy::Retry,
                _ => Remedy::None,
            };
            return Received::Refused(describe(connack.code, connack.text), remedy);
        }
        self.stage = Stage::Accepted;
        if let Some(seconds) = connack.keep_alive {
            self.patience = (seconds > 0).then(|| Duration::from_secs(seconds.into()));
        }
        self.ping_at = self.patience.map(|patience| Instant::now() + patience);
        let unacknowledged = usize::from(connack.receive_maximum);
        self.limits = Limits {
            largest: match connack.maximum_packet {
                u32::MAX => usize::MAX,
                bytes => usize::try_from(bytes).unwrap_or(usize::MAX),
            },
            unacknowledged: unacknowledged.min(MOST_UNACKNOWLEDGED),
            // The other half is left for messages that must be acknowledged.
            awaited: MOST_AWAITED.min(unacknowledged / 2),
            qos: if connack.maximum_qos == 0 {
                QoS::AtMostOnce
            } else {
                QoS::AtLeastOnce
            },
            retains: connack.retains,
        };
        Received::Accepted
    }

    /// Ends the connection, and tells the broker why if possible.
    pub(super) fn refuse(
        &mut self,
        refusal: Refusal,
        out: &mut Vec<u8>,
        received: &mut impl FnMut(Received),
    ) {
        let Refusal {
            reason,
            what: explanation,
        } = refusal;
        if self.stage == Stage::Accepted {
            disconnect(out, reason, explanation, self.version, self.limits.largest);
        }
        self.stage = Stage::Over;
        received(Received::Closed(format!(
            "MQTT protocol error: {explanation}"
        )));
    }
}

/// Describes a reason code, followed by the broker's own text.
fn describe(code: u8, text: Option<&str>) -> String {
    let mut words = reason::name(code).map_or_else(
        || format!("reason code 0x{code:02x}"),
        |name| name.to_owned(),
    );
    if let Some(text) = text.filter(|text| !text.is_empty()) {
        words.push_str(": ");
        for character in text.chars().take(LONGEST_TEXT) {
            match character {
                '"' | '\'' => words.push(character),
                // Escape what a terminal would interpret.
                _ => words.extend(character.escape_debug()),
            }
        }
    }
    words
}

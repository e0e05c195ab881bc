//! Options of a publication.

use swarmwright_packets::client::Properties;

use crate::session::QoS;

/// Options of a publication. MQTT 3.1.1 supports only `qos` and `retain`; the others are then omitted, so the payload
/// must repeat what is needed.
///
/// ```
/// use swarmwright_mqtt::PublishOptions;
///
/// let options = PublishOptions { response_topic: Some("answers/7"), ..PublishOptions::default() };
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PublishOptions<'a> {
    /// Quality of service; at most once by default.
    pub qos: QoS,
    /// Whether the first message on a topic has [`QoS::AtLeastOnce`], so that a broker that denies it reports this
    /// ([`Event::Denied`](crate::Event::Denied)). Not suitable for messages whose second copy does harm.
    pub confirm: bool,
    /// Whether the broker keeps the message for clients that subscribe later.
    pub retain: bool,
    /// Seconds after which the broker may discard the message.
    pub expiry: Option<u32>,
    /// Media type of the payload.
    pub content_type: Option<&'a str>,
    /// Full topic on which an answer is expected.
    pub response_topic: Option<&'a str>,
    /// Data that identifies the answer; at most 65,535 bytes.
    pub correlation: Option<&'a [u8]>,
}

impl<'a> PublishOptions<'a> {
    /// Default options with `confirm`.
    pub const CONFIRMED: Self = Self {
        confirm: true,
        ..Self::PLAIN
    };

    const PLAIN: Self = Self {
        qos: QoS::AtMostOnce,
        confirm: false,
        retain: false,
        expiry: None,
        content_type: None,
        response_topic: None,
        correlation: None,
    };

    pub(crate) fn properties(&self) -> Properties<'a> {
        Properties {
            expiry: self.expiry,
            content_type: self.content_type,
            response_topic: self.response_topic,
            correlation: self.correlation,
        }
    }

    /// Returns the largest size in bytes of a packet without the payload: headers, topic and properties.
    pub(crate) fn room(&self, topic: &str) -> usize {
        let texts = [self.content_type, self.response_topic];
        let texts: usize = texts.iter().flatten().map(|text| text.len() + 3).sum();
        let correlation = self.correlation.map_or(0, |data| data.len() + 3);
        // Fixed header 5, length of the topic 2, identifier 2, length of the properties 4, expiry 5.
        18 + topic.len() + texts + correlation
    }
}

impl Default for PublishOptions<'_> {
    fn default() -> Self {
        Self::PLAIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use swarmwright_packets::{Outgoing, Version, client};

    #[test]
    fn the_room_beside_a_payload_is_never_underrated() {
        let options = PublishOptions {
            content_type: Some("application/msgpack"),
            response_topic: Some("swarmwright/v1/tool/7f3a"),
            correlation: Some(&[1; 8]),
            expiry: Some(7),
            ..PublishOptions::default()
        };
        for options in [options, PublishOptions::default()] {
            let mut packet = Vec::new();
            let topic = "swarmwright/v1/server/1";
            let message = Outgoing {
                topic,
                payload: &[0; 70_000],
                properties: &options.properties().encoded().unwrap(),
                expiry: None,
                identifiers: &[],
                qos: 0,
                retain: false,
                again: false,
                id: 0,
            };
            client::publish(&mut packet, &message, Version::Five, usize::MAX).unwrap();
            let room = packet.len() - 70_000;
            assert!((room..room + 20).contains(&options.room(topic)), "{room}");
        }
    }
}

//! How a message is published.

use crate::session::QoS;

/// How a message is published. What MQTT 3.1.1 does not know (all but `qos` and `retain`) is left out there, so a body
/// has to say it too where it matters.
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
    /// Whether the broker keeps the message for those who subscribe later.
    pub retain: bool,
    /// Seconds after which the broker need not deliver it any more.
    pub expiry: Option<u32>,
    /// Media type of the payload.
    pub content_type: Option<&'a str>,
    /// Full topic on which an answer is expected.
    pub response_topic: Option<&'a str>,
    /// What tells the answer from others; at most 65,535 bytes.
    pub correlation: Option<&'a [u8]>,
}

impl Default for PublishOptions<'_> {
    fn default() -> Self {
        Self {
            qos: QoS::AtMostOnce,
            retain: false,
            expiry: None,
            content_type: None,
            response_topic: None,
            correlation: None,
        }
    }
}

//! Protocol versions and options that brokers accept, learnt from refusals and kept by address for the life of the
//! process.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::session::{QoS, Version};

static LEARNT: Mutex<BTreeMap<String, Dialect>> = Mutex::new(BTreeMap::new());

/// The protocol version and options that a broker accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Dialect {
    pub version: Version,
    /// Quality of service of the last will.
    pub will_qos: QoS,
    /// Whether the broker should retain the last will.
    pub will_retained: bool,
}

/// Change that may help after a failed attempt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Remedy {
    /// Nothing helps.
    None,
    /// Use MQTT 3.1.1.
    Older,
    /// Repeat the attempt: the broker accepted the connection and then closed it, or is busy.
    Retry,
    /// Send the last will with QoS 0.
    WillAtMostOnce,
    /// Do not retain the last will.
    WillNotRetained,
}

impl Dialect {
    /// Returns the options for an unknown broker; a `forced` version is the only one tried.
    pub fn first(forced: Option<Version>) -> Self {
        Self {
            version: forced.unwrap_or(Version::Five),
            will_qos: QoS::AtLeastOnce,
            will_retained: true,
        }
    }

    /// Returns what to try after a failure; `None` if nothing would change, except for [`Remedy::Retry`].
    pub fn after(self, remedy: Remedy, forced: Option<Version>) -> Option<Self> {
        let next = match remedy {
            Remedy::None => return None,
            Remedy::Retry => return Some(self),
            Remedy::Older => Self {
                version: forced.unwrap_or(Version::Three),
                ..self
            },
            Remedy::WillAtMostOnce => Self {
                will_qos: QoS::AtMostOnce,
                ..self
            },
            Remedy::WillNotRetained => Self {
                will_retained: false,
                ..self
            },
        };
        (next != self).then_some(next)
    }

    /// Returns what the broker at this address accepted.
    pub fn learnt(address: &str) -> Option<Self> {
        all().get(address).copied()
    }

    /// Stores what the broker at this address accepted.
    pub fn learn(self, address: &str) {
        all().insert(address.to_owned(), self);
    }

    /// Forgets what was learnt, since another broker may be at this address.
    pub fn forget(address: &str) {
        all().remove(address);
    }
}

fn all() -> MutexGuard<'static, BTreeMap<String, Dialect>> {
    LEARNT.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_remedy_is_tried_once() {
        let first = Dialect::first(None);
        let older = first.after(Remedy::Older, None).unwrap();
        assert_eq!(older.version, Version::Three);
        assert_eq!(older.after(Remedy::Older, None), None);
        let plain = first.after(Remedy::WillAtMostOnce, None).unwrap();
        assert_eq!(plain.will_qos, QoS::AtMostOnce);
        assert_eq!(plain.after(Remedy::WillAtMostOnce, None), None);
        let fleeting = plain.after(Remedy::WillNotRetained, None).unwrap();
        assert!(!fleeting.will_retained && fleeting.will_qos == QoS::AtMostOnce);
        assert_eq!(first.after(Remedy::None, None), None);
        assert_eq!(first.after(Remedy::Retry, None), Some(first));
    }

    #[test]
    fn a_forced_version_is_kept() {
        for version in [Version::Five, Version::Three] {
            let first = Dialect::first(Some(version));
            assert_eq!(first.version, version);
            assert_eq!(first.after(Remedy::Older, Some(version)), None);
        }
    }
}

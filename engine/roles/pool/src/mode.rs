//! Modes of evaluation, and the mode in which each server is used.

use std::fmt;
use std::str::FromStr;

use swarmwright_protocol::{Capabilities, EXTENSION_VERSION};

/// Mode in which servers evaluate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// The fastest mode that each server offers.
    #[default]
    Auto,
    /// Controllers stay in this process; each step of each agent is a message of its own.
    Stepwise,
    /// Controllers stay in this process; one message carries a step of all agents of many episodes.
    Batched,
    /// Controllers are sent to the server.
    Offloaded,
}

impl Mode {
    const ALL: [Self; 4] = [Self::Auto, Self::Stepwise, Self::Batched, Self::Offloaded];

    /// Returns the name used in experiment files and announcements.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Stepwise => "stepwise",
            Self::Batched => "batched",
            Self::Offloaded => "offloaded",
        }
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl FromStr for Mode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|mode| mode.name() == text)
            .ok_or_else(|| {
                let names = Self::ALL.map(Self::name).join(", ");
                format!("mode: {text:?} is unknown; expected one of {names}")
            })
    }
}

/// The mode in which one server is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Way {
    Stepwise,
    /// Batches of at most this many episodes.
    Batched(usize),
    Offloaded,
}

impl Way {
    /// Returns the name used in experiment files and announcements.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stepwise => Mode::Stepwise.name(),
            Self::Batched(_) => Mode::Batched.name(),
            Self::Offloaded => Mode::Offloaded.name(),
        }
    }

    /// Chooses the mode for a server; `kind` is the kind of the controllers, `None` while unknown.
    ///
    /// # Errors
    /// Returns why the server cannot be used in the requested mode.
    pub fn of(mode: Mode, kind: Option<&str>, capabilities: &Capabilities) -> Result<Self, String> {
        let announced = capabilities
            .swarmwright
            .as_ref()
            .filter(|announced| announced.version == EXTENSION_VERSION);
        let offers = |mode: Mode| {
            announced
                .is_some_and(|announced| announced.modes.iter().any(|name| name == mode.name()))
        };
        let knows = |kind: &str| {
            announced.is_some_and(|announced| announced.controllers.iter().any(|name| name == kind))
        };
        let batch = announced.and_then(|announced| announced.batch).unwrap_or(1);
        let offloaded = offers(Mode::Offloaded) && kind.is_none_or(knows);
        match mode {
            Mode::Stepwise => Ok(Self::Stepwise),
            Mode::Auto if offloaded => Ok(Self::Offloaded),
            Mode::Auto | Mode::Batched if offers(Mode::Batched) => Ok(Self::Batched(batch)),
            Mode::Auto => Ok(Self::Stepwise),
            Mode::Offloaded if offloaded => Ok(Self::Offloaded),
            Mode::Offloaded if offers(mode) => Err(format!(
                "does not evaluate controllers of kind {} itself (mode: offloaded)",
                kind.unwrap_or_default()
            )),
            Mode::Batched | Mode::Offloaded => Err(format!(
                "does not offer mode {mode}, which the experiment asks for"
            )),
        }
    }
}

//! Python behaviours and conditions, whose code servers announce.

use serde::{Deserialize, Serialize};

/// The code of a behaviour or a condition.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModuleCode {
    /// behaviour or condition.
    pub role: String,
    /// Name of the class, or the name under which it is installed.
    pub name: String,
    /// File name of the class without its folder; `None` if it is installed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// SHA-256 of the code in hexadecimal; `None` if unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
}

/// Number of digits of a SHA-256 that are shown.
const SHOWN: usize = 16;

impl ModuleCode {
    /// Returns the name used in experiments and with `--modules`.
    fn label(&self) -> String {
        match &self.file {
            Some(file) => format!("{file}:{}", self.name),
            None => self.name.clone(),
        }
    }

    fn is_same(&self, other: &Self) -> bool {
        let same = |own: &str| other.sha256.as_deref() == Some(own);
        self.has_name_of(other) && self.sha256.as_deref().is_none_or(same)
    }

    fn has_name_of(&self, other: &Self) -> bool {
        self.role == other.role && self.name == other.name
    }

    fn shown(&self) -> &str {
        let sha256 = self.sha256.as_deref().unwrap_or("unknown");
        sha256.get(..SHOWN).unwrap_or(sha256)
    }
}

/// Returns why a server with these modules cannot compute machines that need others; `None` if it can.
#[must_use]
pub fn missing_module(announced: &[ModuleCode], needed: &[ModuleCode]) -> Option<String> {
    let missing = needed
        .iter()
        .find(|module| !announced.iter().any(|other| module.is_same(other)))?;
    let (role, label) = (&missing.role, missing.label());
    Some(
        match announced.iter().find(|other| missing.has_name_of(other)) {
            Some(other) => format!(
                "has different code for {role} '{label}' (SHA-256 {}.., expected {}..); start it with the code that the \
                 controllers were designed with, including its imports",
                other.shown(),
                missing.shown()
            ),
            None => {
                format!("has no {role} '{label}'; start it with --modules {label}")
            }
        },
    )
}

//! What an FMU holds: its file `resources/model.json`, which Python writes (`swarmwright/export/simulation_fmu.py`).

use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use swarmwright_worlds::Parameters;

/// Of which type a parameter is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ParameterKind {
    Number,
    Integer,
    Flag,
    /// Text, or JSON where it is not one number or text.
    Text,
    /// JSON as text: positions, objects, lists.
    Json,
}

/// A parameter that masters can set; where none does, the simulation's own default counts.
#[derive(Debug, Clone, Deserialize)]
pub struct ParameterVariable {
    pub name: String,
    pub kind: ParameterKind,
    /// The start value in modelDescription.xml; as long as it is that, the parameter counts as not set.
    pub start: serde_json::Value,
}

/// The content of the file.
#[derive(Debug, Clone, Deserialize)]
pub struct Model {
    /// The GUID of FMI 2.0, the instantiation token of FMI 3.0.
    pub token: String,
    /// Title of the simulation.
    pub title: String,
    /// Parameters that were set at the export and cannot be set otherwise, or have these values unless set.
    pub base: Parameters,
    pub parameters: Vec<ParameterVariable>,
    pub seed: u64,
    pub agents: usize,
    pub sensors: usize,
    pub actuators: usize,
    pub metrics: Vec<String>,
    /// Seconds of a step.
    pub period: f64,
    /// For a proxy: number of spatial dimensions of the required servers. `None`: the simulation is in this process.
    #[serde(default)]
    pub dimensions: Option<f64>,
}

impl Model {
    /// Reads the file in the folder `resources` of the FMU.
    pub fn read(resources: &Path) -> Result<Self, String> {
        let file = resources.join("model.json");
        let text = fs::read_to_string(&file).map_err(|error| {
            format!(
                "{}: {error}; unpack the whole FMU with its folder resources",
                file.display()
            )
        })?;
        serde_json::from_str(&text).map_err(|error| format!("{}: {error}", file.display()))
    }
}

/// The folder that a URI names (`fmuResourceLocation` of FMI 2.0).
pub fn folder(uri: &str) -> Result<PathBuf, String> {
    let path = uri
        .strip_prefix("file://localhost/")
        .or_else(|| uri.strip_prefix("file:///"))
        .or_else(|| uri.strip_prefix("file:/"))
        .ok_or_else(|| {
            format!(
                "the resource location {uri:?} is not a URI of a folder, file:///FOLDER/resources"
            )
        })?;
    let bytes = decoded(path.as_bytes());
    let text = String::from_utf8(bytes)
        .map_err(|_| format!("the resource location {uri:?} is not UTF-8"))?;
    Ok(Path::new("/").join(text))
}

/// Replaces `%20` and the like.
fn decoded(text: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text;
    while let Some((first, others)) = rest.split_first() {
        let byte = match others {
            [high, low, ..] if *first == b'%' => {
                let digits = [*high, *low];
                std::str::from_utf8(&digits)
                    .ok()
                    .and_then(|digits| u8::from_str_radix(digits, 16).ok())
            }
            _ => None,
        };
        rest = if byte.is_some() { &others[2..] } else { others };
        bytes.push(byte.unwrap_or(*first));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_of_folders_become_paths() {
        for uri in [
            "file:///a%20b/c",
            "file:/a%20b/c",
            "file://localhost/a%20b/c",
        ] {
            assert_eq!(folder(uri), Ok(PathBuf::from("/a b/c")), "{uri}");
        }
        assert_eq!(folder("file:///100%/x"), Ok(PathBuf::from("/100%/x")));
        assert!(folder("/a").is_err());
        assert!(folder("http://a/b").is_err());
    }
}

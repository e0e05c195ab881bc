//! How the server is reached: the FMU's parameters `connection.NAME`.

use std::path::PathBuf;
use std::time::Duration;

use serde_json::Value;
use swarmwright_mqtt::Settings;
use swarmwright_worlds::Parameters;

/// Longest time-out, seconds: a year.
const LONGEST: f64 = 31_536_000.0;

/// See the module.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Options {
    /// URL, or the URLs of a cluster, separated by commas.
    pub broker: String,
    /// Topic prefix.
    pub prefix: String,
    pub username: String,
    /// File whose first line is the password.
    pub password_file: String,
    /// Certificate authority, PEM.
    pub ca_file: String,
    /// Title of the simulation.
    pub simulation: String,
    /// The only server to be used; none for any.
    pub server: Option<u64>,
    /// Time limit of the search for a free server.
    pub discovery: Duration,
    /// How long a server may take for a step.
    pub step: Duration,
    /// How long is waited for further agents of a step, where the server does not say how many act.
    pub gather: Duration,
}

impl Options {
    /// Reads the parameters, by their names without `connection.`.
    pub fn read(parameters: &Parameters) -> Result<Self, String> {
        let text = |name: &str| {
            let value = parameters.get(name).and_then(Value::as_str);
            value.unwrap_or_default().trim().to_owned()
        };
        let seconds = |name: &str| match parameters.get(name).and_then(Value::as_f64) {
            Some(seconds) if (0.0..=LONGEST).contains(&seconds) => {
                Ok(Duration::from_secs_f64(seconds))
            }
            Some(other) => Err(format!(
                "parameter connection.{name}: {other} found, expected seconds from 0 to {LONGEST}"
            )),
            None => Err(format!("parameter connection.{name} is missing")),
        };
        let server = parameters.get("server").and_then(Value::as_i64);
        Ok(Self {
            broker: text("broker"),
            prefix: text("prefix"),
            username: text("username"),
            password_file: text("passwordFile"),
            ca_file: text("caFile"),
            simulation: text("simulation"),
            server: server.and_then(|id| u64::try_from(id).ok()),
            discovery: seconds("discoveryTimeout")?,
            step: seconds("stepTimeout")?,
            gather: seconds("gatherTime")?,
        })
    }

    /// Settings of the connection: what the parameters leave open is that of the environment.
    pub fn settings(&self) -> Result<Settings, String> {
        if self.broker.is_empty() {
            return Err(
                "parameter connection.broker is empty, expected a URL such as mqtt://HOST:1883"
                    .to_owned(),
            );
        }
        let wrong = |error: &dyn std::fmt::Display| format!("parameter connection.{error}");
        let mut settings = Settings::from_environment(&self.broker)
            .map_err(|error| wrong(&format!("broker: {error}")))?;
        if !self.username.is_empty() {
            settings.username = Some(self.username.clone());
        }
        if !self.password_file.is_empty() {
            let file = &self.password_file;
            let text = std::fs::read_to_string(file)
                .map_err(|error| wrong(&format!("passwordFile: {file}: {error}")))?;
            settings.password = Some(text.lines().next().unwrap_or_default().to_owned());
            if settings.username.is_none() {
                return Err(wrong(
                    &"username is empty, but there is a passwordFile; set both or neither",
                ));
            }
        }
        if !self.ca_file.is_empty() {
            settings.ca_file = Some(PathBuf::from(&self.ca_file));
        }
        Ok(settings)
    }
}

//! Settings of a connection: URL, credentials, last will.

use std::collections::VecDeque;
use std::net::IpAddr;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;
use std::{env, fmt, fs};

use crate::accounts;
use crate::session::Version;

/// Default keep-alive interval, and its upper limit, in seconds.
const KEEP_ALIVE: u16 = 30;
const LONGEST_KEEP_ALIVE: u16 = 3600;

/// Transport to the broker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scheme {
    /// TCP.
    Mqtt,
    /// TLS.
    Mqtts,
    /// WebSocket.
    Ws,
    /// WebSocket over TLS.
    Wss,
    /// Unix socket.
    Unix,
}

/// URL of a broker: `mqtt://`, `mqtts://`, `ws://` or `wss://` with host, optional port and path, or `unix://` with the
/// absolute path of a Unix socket. A suffix `?mqtt=3` or `?mqtt=5` restricts the connection to one version of MQTT.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BrokerUrl {
    /// Transport to the broker.
    pub scheme: Scheme,
    /// Host name or address, without brackets; empty for a Unix socket.
    pub host: String,
    /// TCP port; 0 for a Unix socket.
    pub port: u16,
    /// Path of a WebSocket, or of the file of a Unix socket.
    pub path: String,
    /// The only version of MQTT to use; `None` to negotiate.
    pub version: Option<Version>,
}

/// Invalid settings; the text says what is expected.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct SettingsError(String);

impl FromStr for BrokerUrl {
    type Err = SettingsError;

    fn from_str(text: &str) -> Result<Self, SettingsError> {
        let wrong = |reason: &str| {
            let shown = text
                .rsplit_once('@')
                .map_or_else(|| text.to_owned(), |(_, rest)| format!("...@{rest}"));
            SettingsError(format!("broker URL {shown:?}: {reason}"))
        };
        let text_with_scheme = if text.contains("://") {
            text.to_owned()
        } else {
            format!("mqtt://{text}")
        };
        let (scheme, rest) = text_with_scheme.split_once("://").unwrap_or_default();
        let (scheme, default_port) = match scheme.to_ascii_lowercase().as_str() {
            "mqtt" | "tcp" => (Scheme::Mqtt, 1883),
            "mqtts" | "ssl" | "tls" => (Scheme::Mqtts, 8883),
            "ws" => (Scheme::Ws, 80),
            "wss" => (Scheme::Wss, 443),
            "unix" => (Scheme::Unix, 0),
            _ => {
                return Err(wrong(
                    "the scheme must be mqtt://, mqtts://, ws://, wss:// or unix://",
                ));
            }
        };
        let (rest, query) = rest.split_once('?').unwrap_or((rest, ""));
        let (version, query) = options(query).map_err(|reason| wrong(&reason))?;
        let unknown = || {
            wrong(&format!(
                "{query:?} is not an option; the options are ?mqtt=3 and ?mqtt=5"
            ))
        };
        if scheme == Scheme::Unix {
            check_socket(rest).map_err(|reason| wrong(&reason))?;
            if !query.is_empty() {
                return Err(unknown());
            }
            return Ok(Self {
                scheme,
                host: String::new(),
                port: 0,
                path: rest.to_owned(),
                version,
            });
        }
        let (authority, path) = rest
            .split_once('/')
            .map_or((rest, ""), |(authority, path)| (authority, path));
        if authority.contains('@') {
            return Err(wrong(
                "credentials do not belong in a URL; set SWARMWRIGHT_USERNAME and SWARMWRIGHT_PASSWORD instead",
            ));
        }
        let authority: http::uri::Authority = authority
            .parse()
            .map_err(|_| wrong("expected HOST or HOST:PORT after the scheme"))?;
        let has_port = authority.as_str().len() > authority.host().len();
        let port = match authority.port_u16() {
            Some(port) if port > 0 => port,
            None if !has_port => default_port,
            _ => return Err(wrong("the port must be a number from 1 to 65535")),
        };
        let host = authority
            .host()
            .trim_start_matches('[')
            .trim_end_matches(']')
            .to_owned();
        if host.is_empty() {
            return Err(wrong("the host is missing"));
        }
        let plain = matches!(scheme, Scheme::Mqtt | Scheme::Mqtts);
        if plain && !path.is_empty() {
            return Err(wrong(
                "mqtt:// and mqtts:// take no path; a topic prefix is the key `prefix` of an experiment, and --prefix of a server",
            ));
        }
        if plain && !query.is_empty() {
            return Err(unknown());
        }
        let mut path = if plain || !path.is_empty() {
            format!("/{path}")
        } else {
            "/mqtt".to_owned()
        };
        if !query.is_empty() {
            path = format!("{path}?{query}");
        }
        Ok(Self {
            scheme,
            host,
            port,
            path,
            version,
        })
    }
}

/// Returns an environment variable; `None` if it is missing or empty.
fn variable(name: &str) -> Option<String> {
    env::var(name).ok().filter(|value| !value.is_empty())
}

/// Returns user name and password from the environment.
fn environment_account() -> Result<(Option<String>, Option<String>), SettingsError> {
    let username = variable("SWARMWRIGHT_USERNAME");
    let password = match (
        variable("SWARMWRIGHT_PASSWORD"),
        variable("SWARMWRIGHT_PASSWORD_FILE"),
    ) {
        (Some(password), _) => Some(password),
        (None, Some(file)) => Some(
            fs::read_to_string(&file)
                .map_err(|error| {
                    SettingsError(format!("SWARMWRIGHT_PASSWORD_FILE {file:?}: {error}"))
                })?
                .lines()
                .next()
                .unwrap_or_default()
                .to_owned(),
        ),
        (None, None) => None,
    };
    if password.is_some() && username.is_none() {
        return Err(SettingsError(
            "a password is set but SWARMWRIGHT_USERNAME is not; set both or neither".to_owned(),
        ));
    }
    Ok((username, password))
}

/// Parses a keep-alive interval in seconds.
fn seconds(text: &str) -> Result<u16, SettingsError> {
    text.parse()
        .ok()
        .filter(|seconds| (1..=LONGEST_KEEP_ALIVE).contains(seconds))
        .ok_or_else(|| {
            SettingsError(format!(
                "SWARMWRIGHT_KEEP_ALIVE: expected whole seconds from 1 to {LONGEST_KEEP_ALIVE}, not {text:?}"
            ))
        })
}

/// Checks the path of a Unix socket.
fn check_socket(path: &str) -> Result<(), String> {
    #[cfg(unix)]
    {
        use swarmwright_sockets::LONGEST_PATH;
        if !path.starts_with('/') {
            return Err(
                "the path must be absolute; write it like unix:///run/mosquitto.sock".to_owned(),
            );
        }
        if path.len() > LONGEST_PATH {
            return Err(format!(
                "the path has {} bytes, but this system allows at most {LONGEST_PATH} for Unix sockets; use a shorter path",
                path.len()
            ));
        }
        Ok(())
    }
    #[cfg(not(unix))]
    {
        let _ = path;
        Err("this system has no Unix sockets for brokers; use mqtt://localhost".to_owned())
    }
}

/// Returns the version of MQTT in the query of a URL, and the other options.
fn options(query: &str) -> Result<(Option<Version>, String), String> {
    let mut version = None;
    let mut others = Vec::new();
    for option in query.split('&').filter(|option| !option.is_empty()) {
        match option.split_once('=') {
            Some(("mqtt", "3")) => version = Some(Version::Three),
            Some(("mqtt", "5")) => version = Some(Version::Five),
            Some(("mqtt", _)) => {
                return Err(format!(
                    "{option:?} is not a version of MQTT; write ?mqtt=3 (for 3.1.1) or ?mqtt=5"
                ));
            }
            _ => others.push(option),
        }
    }
    Ok((version, others.join("&")))
}

impl fmt::Display for BrokerUrl {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        let scheme = match self.scheme {
            Scheme::Mqtt => "mqtt",
            Scheme::Mqtts => "mqtts",
            Scheme::Ws => "ws",
            Scheme::Wss => "wss",
            Scheme::Unix => return write!(formatter, "unix://{}", self.path),
        };
        let path = if self.path == "/" { "" } else { &self.path };
        if self.host.contains(':') {
            write!(formatter, "{scheme}://[{}]:{}{path}", self.host, self.port)
        } else {
            write!(formatter, "{scheme}://{}:{}{path}", self.host, self.port)
        }
    }
}

/// A message that the broker publishes when the connection breaks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Will {
    /// Topic name.
    pub topic: String,
    /// Payload.
    pub payload: Vec<u8>,
    /// Seconds after which the broker discards it (MQTT 5).
    pub expiry: u32,
    /// Whether the broker should retain it for later subscribers, if it can.
    pub retain: bool,
}

/// Settings of a connection.
#[derive(Clone)]
pub struct Settings {
    /// URL of the broker; in a cluster, of the broker in use.
    pub url: BrokerUrl,
    /// Other brokers of the cluster, in the order in which they are tried if that one cannot be reached.
    pub others: VecDeque<BrokerUrl>,
    /// User name at the broker.
    pub username: Option<String>,
    /// Password of the user.
    pub password: Option<String>,
    /// Certificates of trusted authorities (PEM); `None` for those of the system.
    pub ca_file: Option<PathBuf>,
    /// Client certificate, in addition to an account or instead of it.
    pub certificate: Option<ClientCertificate>,
    /// Message that the broker publishes when this connection breaks.
    pub will: Option<Will>,
    /// Keep-alive interval in seconds. A silent broker is pinged and, if it does not answer, given up within the
    /// interval; the broker gives this client up after one and a half intervals.
    pub keep_alive: u16,
    /// Time limit of one attempt to connect.
    pub timeout: Duration,
    /// Whether the caller itself warns about an unencrypted password.
    pub clear_text_is_known: bool,
}

/// Files of a client certificate (PEM).
#[derive(Debug, Clone)]
pub struct ClientCertificate {
    /// The certificate, followed by those of intermediate authorities.
    pub chain: PathBuf,
    /// Its private key, unencrypted.
    pub key: PathBuf,
}

impl Settings {
    /// Creates settings with the account of a broker that this user runs on this machine (see [`crate::Published`]), or
    /// else with credentials from the environment: `SWARMWRIGHT_USERNAME`, `SWARMWRIGHT_PASSWORD` or
    /// `SWARMWRIGHT_PASSWORD_FILE` (first line), `SWARMWRIGHT_CA_FILE`, `SWARMWRIGHT_CERTIFICATE_FILE` with
    /// `SWARMWRIGHT_KEY_FILE`. The keep-alive interval is `SWARMWRIGHT_KEEP_ALIVE`.
    ///
    /// `url` is that of a broker, or of the brokers of a cluster, separated by commas.
    ///
    /// # Errors
    /// Fails if a URL is invalid, if the password file cannot be read, if a password is set without a user name, if
    /// only one of client certificate and key is set, or if the keep-alive interval is not a number of seconds.
    pub fn from_environment(url: &str) -> Result<Self, SettingsError> {
        let mut settings = Self::at(url)?;
        // The account that a broker of this user publishes is right, whatever the environment says about other brokers.
        (settings.username, settings.password) = match settings.account() {
            Some((username, password)) => (Some(username), Some(password)),
            None => environment_account()?,
        };
        let certificate = match (
            variable("SWARMWRIGHT_CERTIFICATE_FILE"),
            variable("SWARMWRIGHT_KEY_FILE"),
        ) {
            (Some(chain), Some(key)) => Some(ClientCertificate {
                chain: chain.into(),
                key: key.into(),
            }),
            (None, None) => None,
            (certificate, _) => {
                let (set, unset) = match certificate {
                    Some(_) => ("SWARMWRIGHT_CERTIFICATE_FILE", "SWARMWRIGHT_KEY_FILE"),
                    None => ("SWARMWRIGHT_KEY_FILE", "SWARMWRIGHT_CERTIFICATE_FILE"),
                };
                return Err(SettingsError(format!(
                    "{set} is set but {unset} is not; a client certificate needs both (PEM)"
                )));
            }
        };
        settings.ca_file = variable("SWARMWRIGHT_CA_FILE").map(PathBuf::from);
        settings.certificate = certificate;
        Ok(settings)
    }

    /// Creates settings without credentials, with the keep-alive interval `SWARMWRIGHT_KEEP_ALIVE` of the environment.
    ///
    /// `url` is that of a broker, or of the brokers of a cluster, separated by commas.
    ///
    /// # Errors
    /// Fails if a URL is invalid, or if the keep-alive interval is not a number of seconds.
    pub fn at(url: &str) -> Result<Self, SettingsError> {
        let mut urls = url
            .split(',')
            .map(|url| url.trim().parse())
            .collect::<Result<VecDeque<BrokerUrl>, _>>()?;
        let first = urls
            .pop_front()
            .ok_or_else(|| SettingsError("no broker is named".to_owned()))?;
        let mut settings = Self::new(first);
        settings.others = urls;
        if let Some(text) = variable("SWARMWRIGHT_KEEP_ALIVE") {
            settings.keep_alive = seconds(&text)?;
        }
        Ok(settings)
    }

    /// Creates settings without credentials.
    #[must_use]
    pub fn new(url: BrokerUrl) -> Self {
        Self {
            url,
            others: VecDeque::new(),
            username: None,
            password: None,
            ca_file: None,
            certificate: None,
            will: None,
            keep_alive: KEEP_ALIVE,
            timeout: Duration::from_secs(5),
            clear_text_is_known: false,
        }
    }

    /// Returns the account of a broker that this user runs on this machine; `None` if remote brokers would get the
    /// password, too.
    fn account(&self) -> Option<(String, String)> {
        let is_elsewhere = |url: &BrokerUrl| url.scheme != Scheme::Unix && !is_loopback(&url.host);
        let mut urls = std::iter::once(&self.url).chain(&self.others);
        if urls.clone().any(is_elsewhere) {
            return None;
        }
        urls.find_map(accounts::find)
    }

    /// Switches to the next broker of the cluster; the current one becomes the last to be tried.
    pub(crate) fn next_broker(&mut self) {
        if let Some(next) = self.others.pop_front() {
            self.others
                .push_back(std::mem::replace(&mut self.url, next));
        }
    }

    /// Returns a warning for the operator if the password leaves this machine unencrypted.
    #[must_use]
    pub fn clear_text_warning(&self) -> Option<String> {
        let url = std::iter::once(&self.url).chain(&self.others).find(|url| {
            matches!(url.scheme, Scheme::Mqtt | Scheme::Ws) && !is_loopback(&url.host)
        })?;
        (self.password.is_some() && !self.clear_text_is_known).then(|| {
            format!(
                "the password for {}:{} travels unencrypted and can be read on the network path; use a broker with TLS, mqtts://",
                url.host, url.port
            )
        })
    }

    pub(crate) fn who(&self) -> String {
        self.username.as_ref().map_or_else(
            || "a client without a user name".to_owned(),
            |name| format!("user {name:?}"),
        )
    }
}

fn is_loopback(host: &str) -> bool {
    let host = host.to_ascii_lowercase();
    host == "localhost"
        || host.ends_with(".localhost")
        || host.parse::<IpAddr>().is_ok_and(|host| host.is_loopback())
}

impl fmt::Debug for Settings {
    /// Omits the password.
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter
            .debug_struct("Settings")
            .field("url", &self.url)
            .field("username", &self.username)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_are_read_with_their_defaults() {
        for (text, shown) in [
            ("mqtt://localhost", "mqtt://localhost:1883"),
            ("localhost:1884", "mqtt://localhost:1884"),
            ("mqtts://broker.example", "mqtts://broker.example:8883"),
            ("ws://localhost:9001", "ws://localhost:9001/mqtt"),
            ("wss://localhost/a/b", "wss://localhost:443/a/b"),
            ("mqtt://[::1]:1883", "mqtt://[::1]:1883"),
            #[cfg(unix)]
            ("unix:///run/a b.sock", "unix:///run/a b.sock"),
        ] {
            assert_eq!(text.parse::<BrokerUrl>().unwrap().to_string(), shown);
        }
    }

    #[test]
    fn a_password_that_leaves_the_machine_unencrypted_is_warned_of() {
        for (url, warned) in [
            ("mqtt://broker.example", true),
            ("ws://192.0.2.1", true),
            ("mqtts://broker.example", false),
            ("wss://broker.example", false),
            ("mqtt://localhost", false),
            ("mqtt://127.0.0.2", false),
            ("ws://[::1]", false),
            #[cfg(unix)]
            ("unix:///run/broker.sock", false),
        ] {
            let mut settings = Settings::new(url.parse().unwrap());
            assert_eq!(settings.clear_text_warning(), None);
            settings.password = Some("secret".to_owned());
            let warning = settings.clear_text_warning();
            assert_eq!(warning.is_some(), warned, "{url}");
            assert!(warning.is_none_or(|text| !text.contains("secret")));
        }
    }

    #[test]
    fn the_brokers_of_a_cluster_are_tried_in_turn() {
        let mut settings = Settings::from_environment("mqtt://one, two:1884,ws://three").unwrap();
        let mut shown = Vec::new();
        for _ in 0..4 {
            shown.push(settings.url.to_string());
            settings.next_broker();
        }
        assert_eq!(
            shown,
            [
                "mqtt://one:1883",
                "mqtt://two:1884",
                "ws://three:80/mqtt",
                "mqtt://one:1883"
            ]
        );
        for wrong in [
            "",
            "mqtt://one,",
            "mqtt://one,,two",
            "mqtt://one,http://two",
        ] {
            assert!(Settings::from_environment(wrong).is_err(), "{wrong:?}");
        }
        settings.password = Some("secret".to_owned());
        assert!(settings.clear_text_warning().is_some());
    }

    #[test]
    fn keep_alive_intervals_are_whole_seconds() {
        assert_eq!(seconds("5"), Ok(5));
        for wrong in ["0", "3601", "-1", "2.5", "often", " 5"] {
            let error = seconds(wrong).unwrap_err().to_string();
            assert!(error.contains("from 1 to 3600") && error.contains(wrong));
        }
    }

    #[test]
    fn a_url_may_ask_for_a_version_of_mqtt() {
        for (text, shown, version) in [
            (
                "mqtt://localhost?mqtt=3",
                "mqtt://localhost:1883",
                Some(Version::Three),
            ),
            (
                "localhost:1884/?mqtt=5",
                "mqtt://localhost:1884",
                Some(Version::Five),
            ),
            (
                "ws://localhost?mqtt=3",
                "ws://localhost:80/mqtt",
                Some(Version::Three),
            ),
            (
                "ws://localhost/a?x=1&mqtt=5&y=2",
                "ws://localhost:80/a?x=1&y=2",
                Some(Version::Five),
            ),
            #[cfg(unix)]
            (
                "unix:///run/broker.sock?mqtt=3",
                "unix:///run/broker.sock",
                Some(Version::Three),
            ),
            ("ws://localhost/a?x=1", "ws://localhost:80/a?x=1", None),
        ] {
            let url: BrokerUrl = text.parse().unwrap();
            assert_eq!((url.to_string().as_str(), url.version), (shown, version));
        }
    }

    #[test]
    fn urls_that_cannot_be_say_why_and_never_repeat_a_password() {
        #[cfg(unix)]
        let long = format!("unix:///{}", "x".repeat(107));
        for (text, why) in [
            ("http://localhost", "scheme"),
            #[cfg(unix)]
            ("unix://run/broker.sock", "must be absolute"),
            #[cfg(unix)]
            ("unix://", "must be absolute"),
            #[cfg(unix)]
            ("unix:///run/broker.sock?clean=1", "?mqtt=3 and ?mqtt=5"),
            #[cfg(unix)]
            (&long, "the path has 108 bytes"),
            #[cfg(not(unix))]
            ("unix:///run/broker.sock", "no Unix sockets"),
            ("mqtt://", "HOST"),
            ("mqtt://localhost:99999", "port"),
            ("mqtt://localhost:0", "port"),
            ("mqtt://localhost/lab", "--prefix"),
            ("mqtt://localhost?mqtt=4", "?mqtt=3 (for 3.1.1) or ?mqtt=5"),
            ("mqtt://localhost?clean=1", "?mqtt=3 and ?mqtt=5"),
            ("mqtt://me:secret@localhost", "SWARMWRIGHT_PASSWORD"),
        ] {
            let error = text.parse::<BrokerUrl>().unwrap_err().to_string();
            assert!(error.contains(why), "{text}: {error}");
            assert!(!error.contains("secret"), "{error}");
        }
    }
}

//! The command line, read without a library so that the client builds in a second.

use std::str::FromStr;

/// What is printed for `--help` and for a wrong command line.
pub const USAGE: &str = "\
Bare MQTT over blocking sockets: QoS 0, packets encoded by hand, one JSON line on standard output.

usage: mqtt-bare pingpong|flood|burst --port P [options]
       mqtt-bare relay --port P

  pingpong   one message at a time, there (--topic) and back (--back) through the broker
  flood      as many messages a second as arrive, at most --window of them under way per pair
  burst      --count messages to a reader that reads only afterwards: how many are lost?
  relay      no broker at all: joins each two connections, byte for byte (use with --raw)

  --host H       127.0.0.1       --port P      required
  --bytes N      200             --payload T   this text in place of N bytes
  --count N      pingpong 20000, flood 500000, burst 10000
  --window N     500             --topic T     bare          --back T   bare/back
  --pairs N      1 writers, each with a topic (T/0, T/1, ... when several) and readers of its own
  --readers N    1 readers per writer
  --mqtt 5|3     protocol version 5 or 3.1.1
  --raw          no CONNECT and no SUBSCRIBE: the peer is the relay

example: mqtt-bare pingpong --port 1883 --count 10000";

/// What to measure.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Test {
    /// Round trips, one after another.
    PingPong,
    /// Messages per second.
    Flood,
    /// Loss to a reader that is behind.
    Burst,
    /// Not a test: the TCP relay.
    Relay,
}

/// A command line, checked.
pub struct Options {
    /// What to measure.
    pub test: Test,
    /// Address of the broker.
    pub host: String,
    /// TCP port of the broker.
    pub port: u16,
    /// What every message carries.
    pub payload: Vec<u8>,
    /// Messages per pair.
    pub count: u64,
    /// Messages under way per pair, flood only.
    pub window: u64,
    /// Topic there.
    pub topic: String,
    /// Topic back, ping-pong only.
    pub back: String,
    /// Writers, each with a topic of its own.
    pub pairs: usize,
    /// Readers of each topic.
    pub readers: usize,
    /// MQTT 5, else 3.1.1.
    pub five: bool,
    /// Skip the handshake.
    pub raw: bool,
}

impl Options {
    /// Reads the arguments after the program's name; an error says which one is wrong.
    pub fn read(mut arguments: impl Iterator<Item = String>) -> Result<Self, String> {
        let test = match arguments.next().as_deref() {
            Some("pingpong") => Test::PingPong,
            Some("flood") => Test::Flood,
            Some("burst") => Test::Burst,
            Some("relay") => Test::Relay,
            other => {
                return Err(format!(
                    "pingpong, flood, burst or relay expected, not {other:?}"
                ));
            }
        };
        let mut options = Self {
            test,
            host: "127.0.0.1".into(),
            port: 0,
            payload: Vec::new(),
            count: match test {
                Test::Flood => 500_000,
                Test::Burst => 10_000,
                Test::PingPong | Test::Relay => 20_000,
            },
            window: 500,
            topic: "bare".into(),
            back: "bare/back".into(),
            pairs: 1,
            readers: 1,
            five: true,
            raw: false,
        };
        let mut bytes = 200;
        let mut payload = None;
        while let Some(name) = arguments.next() {
            if name == "--raw" {
                options.raw = true;
                continue;
            }
            let value = arguments
                .next()
                .ok_or_else(|| format!("{name} needs a value"))?;
            match name.as_str() {
                "--host" => options.host = value,
                "--port" => options.port = number(&name, &value)?,
                "--bytes" => bytes = number(&name, &value)?,
                "--payload" => payload = Some(value.into_bytes()),
                "--count" => options.count = number(&name, &value)?,
                "--window" => options.window = number(&name, &value)?,
                "--topic" => options.topic = value,
                "--back" => options.back = value,
                "--pairs" => options.pairs = number(&name, &value)?,
                "--readers" => options.readers = number(&name, &value)?,
                "--mqtt" if value == "5" || value == "3" => options.five = value == "5",
                _ => return Err(format!("unknown option {name} {value}")),
            }
        }
        options.payload = payload.unwrap_or_else(|| vec![b'x'; bytes]);
        if options.port == 0 && test != Test::Relay {
            return Err("--port is missing".into());
        }
        let positive = options
            .count
            .min(options.window)
            .min(options.pairs as u64)
            .min(options.readers as u64);
        if positive == 0 {
            return Err("--count, --window, --pairs and --readers must be at least 1".into());
        }
        Ok(options)
    }

    /// The topic of a pair: `--topic` itself when there is only one.
    pub fn topic_of(&self, pair: usize) -> String {
        if self.pairs == 1 {
            self.topic.clone()
        } else {
            format!("{}/{pair}", self.topic)
        }
    }
}

fn number<T: FromStr>(name: &str, value: &str) -> Result<T, String> {
    value
        .parse()
        .map_err(|_| format!("{name} {value}: a whole number expected"))
}

//! The command line, read without a library so that the client builds in a second.

use crate::swarm::TAG;
use std::str::FromStr;

/// What is printed for `--help` and for a wrong command line.
pub const USAGE: &str = "\
Bare MQTT over blocking sockets: QoS 0, packets encoded by hand, one JSON line on standard output.

usage: mqtt-bare pingpong|flood|burst|swarm --port P [options]
       mqtt-bare relay --port P

  pingpong   one message at a time, there (--topic) and back (--back) through the broker
  flood      as many messages a second as arrive, at most --window of them under way per pair
  burst      --count messages to a reader that reads only afterwards: how many are lost?
  swarm      --servers processes send --agents messages on --topic to one process that answers each on --back, which
             all servers read; a server's next step begins when all its answers are there; --count steps each
  relay      no broker at all: joins each two connections, byte for byte (use with --raw)

  --host H       127.0.0.1       --port P      required
  --bytes N      200             --payload T   this text in place of N bytes
  --bytes-back N 200             the answer's, pingpong and swarm; default: as --bytes
  --count N      pingpong 20000, flood 500000, burst 10000, swarm 2000
  --window N     500             --batch N     1 messages per write, flood only
  --topic T     bare          --back T   bare/back
  --pairs N      1 writers, each with a topic (T/0, T/1, ... when several) and readers of its own
  --readers N    1 readers per writer
  --servers N    8               --agents N    1             swarm only
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
    /// Stepwise evaluation's messages alone.
    Swarm,
    /// Not a test: one server of the swarm.
    SwarmServer,
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
    /// Bytes of an answer, ping-pong and swarm only.
    pub bytes_back: usize,
    /// Messages per pair, or steps per server.
    pub count: u64,
    /// Messages under way per pair, flood only.
    pub window: u64,
    /// Messages handed to the operating system at once, flood only. Plain clients write each message on its own.
    pub batch: u64,
    /// Topic there.
    pub topic: String,
    /// Topic back, ping-pong only.
    pub back: String,
    /// Writers, each with a topic of its own.
    pub pairs: usize,
    /// Readers of each topic.
    pub readers: usize,
    /// Server processes, swarm only.
    pub servers: usize,
    /// Messages that a server sends in a step, swarm only.
    pub agents: usize,
    /// Which server of the swarm this process is.
    pub number: u16,
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
            Some("swarm") => Test::Swarm,
            Some("swarm-server") => Test::SwarmServer,
            other => {
                return Err(format!(
                    "pingpong, flood, burst, swarm or relay expected, not {other:?}"
                ));
            }
        };
        let mut options = Self {
            test,
            host: "127.0.0.1".into(),
            port: 0,
            payload: Vec::new(),
            bytes_back: 0,
            count: match test {
                Test::Flood => 500_000,
                Test::Burst => 10_000,
                Test::Swarm | Test::SwarmServer => 2_000,
                Test::PingPong | Test::Relay => 20_000,
            },
            window: 500,
            batch: 1,
            topic: "bare".into(),
            back: "bare/back".into(),
            pairs: 1,
            readers: 1,
            servers: 8,
            agents: 1,
            number: 0,
            five: true,
            raw: false,
        };
        let mut bytes = 200;
        let mut bytes_back = None;
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
                "--bytes-back" => bytes_back = Some(number(&name, &value)?),
                "--payload" => payload = Some(value.into_bytes()),
                "--count" => options.count = number(&name, &value)?,
                "--window" => options.window = number(&name, &value)?,
                "--batch" => options.batch = number(&name, &value)?,
                "--topic" => options.topic = value,
                "--back" => options.back = value,
                "--pairs" => options.pairs = number(&name, &value)?,
                "--readers" => options.readers = number(&name, &value)?,
                "--servers" => options.servers = number(&name, &value)?,
                "--agents" => options.agents = number(&name, &value)?,
                "--number" => options.number = number(&name, &value)?,
                "--mqtt" if value == "5" || value == "3" => options.five = value == "5",
                _ => return Err(format!("unknown option {name} {value}")),
            }
        }
        options.payload = payload.unwrap_or_else(|| vec![b'x'; bytes]);
        options.bytes_back = bytes_back.unwrap_or(options.payload.len());
        if options.port == 0 && test != Test::Relay {
            return Err("--port is missing".into());
        }
        let positive = options
            .count
            .min(options.window)
            .min(options.pairs as u64)
            .min(options.readers as u64)
            .min(options.servers as u64)
            .min(options.agents as u64);
        if positive == 0 {
            return Err(
                "--count, --window, --batch, --pairs, --readers, --servers and --agents must be at least 1"
                    .into(),
            );
        }
        let tagged = matches!(test, Test::Swarm | Test::SwarmServer);
        if tagged && options.payload.len().min(options.bytes_back) < TAG {
            return Err(format!("--bytes and --bytes-back must be at least {TAG}"));
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

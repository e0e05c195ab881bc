//! Password guessing over real sockets must not lock other clients out; and reloading of files.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests"
)]

use crate::common;

use common::{CONNACK, Client, DISCONNECT, Hello, in_time};
use socket2::{Domain, Socket, Type};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::num::NonZeroU32;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};
use swarmwright_broker::{Broker, Config, hash_for_mosquitto, hash_password};

fn users(path: &Path, accounts: &[(&str, &str)]) {
    let lines: Vec<String> = accounts
        .iter()
        .map(|(user, password)| format!("{user}:{}\n", hash_password(password).unwrap()))
        .collect();
    std::fs::write(path, lines.concat()).unwrap();
}

fn hello<'a>(user: &'a str, password: &'a str) -> Hello<'a> {
    Hello {
        user: Some((user, password)),
        ..Hello::default()
    }
}

/// Returns the median round-trip time in milliseconds.
fn round_trip(client: &mut Client<TcpStream>) -> f64 {
    let mut times: Vec<f64> = (0..200)
        .map(|_| {
            let begin = Instant::now();
            client.publish("echo", false, b"there?");
            assert_eq!(client.hear_payload(), "there?");
            begin.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[100]
}

/// Connects with one wrong password after another, as fast as possible, and counts the answers.
fn guess(port: u16, user: fn(usize) -> String, stop: &AtomicBool, answered: &AtomicUsize) {
    while !stop.load(Ordering::Relaxed) {
        let number = answered.fetch_add(1, Ordering::Relaxed);
        let Ok(mut stream) = TcpStream::connect(("127.0.0.1", port)) else {
            continue;
        };
        stream
            .set_read_timeout(Some(Duration::from_secs(5)))
            .unwrap();
        let (user, password) = (user(number), number.to_string());
        if stream.write_all(&hello(&user, &password).bytes()).is_ok() {
            let mut answer = [0; 4];
            if stream.read_exact(&mut answer).is_ok() {
                assert_ne!(answer[3], 0, "a guess was right");
            }
        }
    }
}

const HERE: [u8; 4] = [127, 0, 0, 1];
const ELSEWHERE: [u8; 4] = [127, 0, 0, 2];

/// Connects from an address of this machine.
fn connect(from: [u8; 4], port: u16) -> TcpStream {
    let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
    let from = SocketAddr::from((Ipv4Addr::from(from), 0));
    socket.bind(&from.into()).unwrap();
    let to = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    socket.connect(&to.into()).unwrap();
    socket.into()
}

/// Returns the answer to a right password.
fn knock(from: [u8; 4], port: u16, user: &str) -> u8 {
    let mut stream = connect(from, port);
    stream
        .set_read_timeout(Some(Duration::from_secs(10)))
        .unwrap();
    stream.write_all(&hello(user, "correct").bytes()).unwrap();
    let mut answer = [0; 4];
    stream.read_exact(&mut answer).unwrap();
    assert_eq!(answer[0], CONNACK);
    answer[3]
}

fn newcomers_get_in_while_others_guess(guessed: fn(usize) -> String, from: [u8; 4]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("users");
    let names: Vec<String> = (0..12).map(|number| format!("lab{number}")).collect();
    let mut accounts: Vec<(&str, &str)> = names.iter().map(|name| (&**name, "correct")).collect();
    accounts.push(("tool", "horse"));
    // Use fast hashes, so that the speed of the machine does not matter.
    let lines = accounts.iter().map(|(user, password)| {
        let hash = hash_for_mosquitto(password, NonZeroU32::new(1000).unwrap()).unwrap();
        format!("{user}:{hash}\n")
    });
    std::fs::write(&path, lines.collect::<String>()).unwrap();
    let broker = Broker::start(&Config {
        users: Some(path),
        ..Config::default()
    })
    .unwrap();
    let mut honest = Client::join(&broker, &hello("tool", "horse"));
    honest.subscribe("echo", 0);
    let quiet = round_trip(&mut honest);
    let (stop, answered) = (
        Arc::new(AtomicBool::new(false)),
        Arc::new(AtomicUsize::new(0)),
    );
    let guessers: Vec<_> = (0..32)
        .map(|_| {
            let (stop, answered, port) = (Arc::clone(&stop), Arc::clone(&answered), broker.port());
            thread::spawn(move || guess(port, guessed, &stop, &answered))
        })
        .collect();
    thread::sleep(Duration::from_secs(1));
    for name in &names {
        // Tools and servers retry up to four times, too.
        let tries = (0..5).find(|_| knock(from, broker.port(), name) == 0);
        assert!(tries.is_some(), "{name} is kept out");
    }
    let busy = round_trip(&mut honest);
    stop.store(true, Ordering::Relaxed);
    for guesser in guessers {
        guesser.join().unwrap();
    }
    // Allow a millisecond, for machines that are busy with other tests.
    assert!(busy < 10.0 * quiet.max(0.1) + 1.0, "{quiet} ms, {busy} ms");
}

#[test]
fn clients_of_the_same_network_log_in_while_others_guess_at_one_account() {
    in_time(|| newcomers_get_in_while_others_guess(|_| "tool".into(), HERE));
}

#[test]
fn clients_of_another_network_log_in_while_others_guess_at_many_accounts() {
    in_time(|| newcomers_get_in_while_others_guess(|number| format!("user{number}"), ELSEWHERE));
}

#[test]
fn clients_of_the_same_network_log_in_while_others_guess_at_many_accounts() {
    in_time(|| newcomers_get_in_while_others_guess(|number| format!("user{number}"), HERE));
}

#[test]
fn unauthenticated_connections_leave_room_for_others() {
    in_time(|| {
        let mut config = Config {
            ..Config::default()
        };
        config.limits.clients = 40;
        let broker = Broker::start(&config).unwrap();
        let mut idle = Vec::new();
        for _ in 0..60 {
            idle.push(connect(HERE, broker.port()));
            let mut stream = connect(ELSEWHERE, broker.port());
            stream.write_all(&Hello::default().bytes()).unwrap();
            let mut answer = [0; 4];
            stream.read_exact(&mut answer).unwrap();
            assert_eq!((answer[0], answer[3]), (CONNACK, 0));
        }
    });
}

#[test]
fn a_thousand_servers_of_one_account_reconnect_at_once() {
    in_time(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("users");
        let hash = hash_for_mosquitto("horse", NonZeroU32::new(210_000).unwrap()).unwrap();
        std::fs::write(&path, format!("server:{hash}\n")).unwrap();
        let broker = Broker::start(&Config {
            users: Some(path),
            ..Config::default()
        })
        .unwrap();
        let begin = Instant::now();
        for _ in 0..400 {
            Client::join(&broker, &hello("server", "horse"));
        }
        // One hash takes some 0.1 s, so 400 would take longer.
        assert!(
            begin.elapsed() < Duration::from_secs(10),
            "{:?}",
            begin.elapsed()
        );
    });
}

#[test]
fn removed_accounts_are_disconnected_and_the_others_stay() {
    in_time(|| {
        let folder = tempfile::tempdir().unwrap();
        let (path, rules) = (folder.path().join("users"), folder.path().join("access"));
        users(&path, &[("ada", "a"), ("bob", "b"), ("eve", "e")]);
        std::fs::write(&rules, "pattern readwrite echo\n").unwrap();
        let broker = Broker::start(&Config {
            users: Some(path.clone()),
            access: Some(rules.clone()),
            ..Config::default()
        })
        .unwrap();
        let mut clients = [("ada", "a"), ("bob", "b"), ("eve", "e")]
            .map(|(user, password)| Client::join(&broker, &hello(user, password)));
        for client in &mut clients {
            client.subscribe("echo", 0);
        }
        let [mut ada, mut bob, mut eve] = clients;
        let text = std::fs::read_to_string(&path).unwrap();
        // Bob is removed, Eve has another password, Ada is unchanged.
        let kept = text.lines().next().unwrap();
        let other = hash_password("new").unwrap();

        // An invalid file changes nothing.
        std::fs::write(&path, format!("{kept}\neve:readable\n")).unwrap();
        let message = broker.reload().unwrap_err().to_string();
        assert!(
            message.contains("line 2") && !message.contains("readable"),
            "{message}"
        );
        bob.publish("echo", false, b"still here");
        for client in [&mut ada, &mut bob, &mut eve] {
            assert_eq!(client.hear_payload(), "still here");
        }

        std::fs::write(&path, format!("{kept}\neve:{other}\n")).unwrap();
        std::fs::write(&rules, "user ada\ntopic readwrite news\n").unwrap();
        broker.reload().unwrap();
        assert_eq!(bob.expect(DISCONNECT)[0], 0x87);
        assert_eq!(eve.expect(DISCONNECT)[0], 0x98);
        assert_eq!(Client::knock(&broker, &hello("bob", "b")).1, 0x86);
        assert_eq!(Client::knock(&broker, &hello("eve", "e")).1, 0x86);
        let mut eve = Client::join(&broker, &hello("eve", "new"));
        eve.subscribe("news", 0);
        // The new rules also apply to clients that stay connected.
        ada.subscribe("news", 0);
        ada.publish("echo", false, b"denied");
        ada.publish("news", false, b"allowed");
        assert_eq!(ada.hear_payload(), "allowed");
    });
}

//! Order of checks in virtual time, and the duration of real hashes.

use super::queue::{CheckQueue, Key};
use super::*;
use std::time::Duration;

/// A queue with one thread, and a clock that only moves when told.
struct Stage {
    queue: CheckQueue,
    now: Instant,
    link: usize,
}

const TOOK: Duration = Duration::from_millis(25);

impl Stage {
    fn new() -> Self {
        Self {
            queue: CheckQueue::new(1).unwrap(),
            now: Instant::now(),
            link: 0,
        }
    }

    fn account(&self, user: &str) -> Key {
        self.queue.key(&[user.as_bytes()])
    }

    fn pair(&self, user: &str, password: &str) -> Key {
        self.queue.key(&[user.as_bytes(), password.as_bytes()])
    }

    /// Sends a password from a new connection, and returns its number.
    fn come(&mut self, network: &str, user: &str, password: &str) -> usize {
        let (account, pair) = (self.account(user), self.pair(user, password));
        self.link += 1;
        self.queue.join(self.link, network, account, pair, self.now);
        self.link
    }

    /// Runs the next check with a wrong password, and returns its connection.
    fn guess(&mut self) -> Option<usize> {
        let (pair, link) = self.queue.next(self.now)?;
        self.queue.ended(&pair, None, TOOK, self.now);
        Some(link)
    }

    /// Runs the next check with a right password, and returns its connection.
    fn admit(&mut self, user: &str) -> Option<usize> {
        let (pair, link) = self.queue.next(self.now)?;
        self.queue.ended(&pair, Some(user), TOOK, self.now);
        Some(link)
    }

    fn pass(&mut self, milliseconds: u64) {
        self.now += Duration::from_millis(milliseconds);
    }

    /// Sends 1,300 guesses per second for this many seconds. Returns how many were checked.
    fn flood(&mut self, seconds: u64, from: impl Fn(u64) -> (String, String)) -> usize {
        let mut looked = 0;
        for number in 0..seconds * 1300 {
            let (network, user) = from(number);
            self.come(&network, &user, &number.to_string());
            if number % 13 == 0 {
                self.pass(10);
                looked += std::iter::from_fn(|| self.guess()).count();
                self.queue.late(self.now);
                self.queue.sweep(self.now);
            }
        }
        looked
    }
}

#[test]
fn guesses_are_checked_within_the_rates_of_their_network_and_account() {
    let mut stage = Stage::new();
    let of_network = stage.flood(20, |_| ("evil".into(), "tool".into()));
    assert!((70..=16 + 4 * 20).contains(&of_network), "{of_network}");
    let mut stage = Stage::new();
    let of_names = stage.flood(20, |number| ("evil".into(), number.to_string()));
    assert!((150..=8 + 8 * 20).contains(&of_names), "{of_names}");
    let mut stage = Stage::new();
    let of_many = stage.flood(20, |number| {
        (format!("evil {}", number % 100), "tool".into())
    });
    assert!((70..=16 + 4 * 20).contains(&of_many), "{of_many}");
    // In any case at most half of a processor: 20 checks per second of 25 ms each.
    let mut stage = Stage::new();
    let of_all = stage.flood(20, |number| {
        (format!("evil {}", number % 100), number.to_string())
    });
    assert!((300..=20 * 21).contains(&of_all), "{of_all}");
}

#[test]
fn clients_of_other_networks_and_of_other_accounts_are_next() {
    for (network, user) in [("home", "tool"), ("home", "ada"), ("evil", "ada")] {
        let mut stage = Stage::new();
        for round in 0..21 {
            stage.flood(1, |_| ("evil".into(), "tool".into()));
            let name = format!("{user}{round}");
            let user = if user == "tool" { user } else { &name };
            let client = stage.come(network, user, "right");
            let mut waited = 0;
            while stage.queue.next(stage.now).is_none_or(|(pair, link)| {
                let is_client = link == client;
                let right = is_client.then_some(user);
                stage.queue.ended(&pair, right, TOOK, stage.now);
                !is_client
            }) {
                waited += 5;
                stage.pass(5);
                stage.come("evil", "tool", &waited.to_string());
                assert!(waited < 500, "{user} of {network} waits in round {round}");
            }
        }
    }
}

#[test]
fn of_equals_the_newest_is_next_after_accounts_that_the_network_is_trusted_for() {
    let mut stage = Stage::new();
    let first = stage.come("lab", "tool", "a");
    let second = stage.come("lab", "tool", "b");
    assert_eq!((stage.guess(), stage.guess()), (Some(second), Some(first)));
    // Checks for accounts under attack from many networks wait, unless the network is trusted for the account.
    let mut stage = Stage::new();
    stage.come("lab", "tool", "right");
    assert!(stage.admit("tool").is_some());
    stage.flood(20, |number| {
        (format!("evil {}", number % 100), "tool".into())
    });
    stage.pass(100);
    let stranger = stage.come("elsewhere", "tool", "other");
    let known = stage.come("lab", "tool", "new one");
    let newer = stage.come("somewhere", "tool", "third");
    assert_eq!(stage.admit("tool"), Some(known), "{stranger} {newer}");
}

#[test]
fn an_account_that_is_guessed_at_where_it_comes_from_does_not_keep_others_out() {
    let mut stage = Stage::new();
    stage.come("lab", "tool", "right");
    assert!(stage.admit("tool").is_some());
    stage.flood(5, |_| ("lab".into(), "tool".into()));
    let client = stage.come("lab", "ada", "right");
    stage.come("lab", "tool", "guess");
    stage.pass(200);
    assert_eq!(stage.admit("ada"), Some(client));
}

#[test]
fn clients_that_retry_when_told_to_are_checked_before_further_guesses() {
    let mut stage = Stage::new();
    for client in 0..21 {
        let name = format!("lab{client}");
        let mut tries = 0;
        'tries: loop {
            tries += 1;
            assert!(tries <= 3, "{name} is kept out");
            let link = stage.come("evil", &name, "right");
            for number in 0..3000 {
                // Guesses for ever new names from the same network.
                let guess = format!("{client} {tries} {number}");
                stage.come("evil", &guess, "guess");
                if number % 13 == 0 {
                    stage.pass(10);
                }
                while let Some((pair, looked)) = stage.queue.next(stage.now) {
                    let right = (looked == link).then_some(&*name);
                    stage.queue.ended(&pair, right, TOOK, stage.now);
                    if looked == link {
                        break 'tries;
                    }
                }
                if stage.queue.late(stage.now).contains(&link) {
                    break;
                }
            }
        }
    }
}

#[test]
fn a_thousand_connections_of_one_account_take_one_check() {
    let mut stage = Stage::new();
    let links: Vec<usize> = (0..1000)
        .map(|_| stage.come("lab", "server", "right"))
        .collect();
    let (pair, _) = stage.queue.next(stage.now).unwrap();
    assert_eq!(stage.queue.next(stage.now), None);
    let waited = stage.queue.ended(&pair, Some("server"), TOOK, stage.now);
    assert_eq!(waited, links);
    let account = stage.account("server");
    assert!(stage.queue.is_admitted(&pair, "lab", account));
    stage.queue.keep_admitted(|user| user != "server");
    assert!(!stage.queue.is_admitted(&pair, "lab", account));
}

#[test]
fn right_passwords_cost_nothing() {
    let mut stage = Stage::new();
    for number in 0..200 {
        stage.come("lab", &number.to_string(), "right");
        assert!(stage.admit(&number.to_string()).is_some(), "{number}");
    }
}

#[test]
fn waiting_clients_are_limited_and_told_to_retry_later() {
    let mut stage = Stage::new();
    let mut told = Vec::new();
    for number in 0..5000 {
        stage.come(&format!("net {}", number % 30), &number.to_string(), "x");
        told.extend(stage.queue.late(stage.now));
    }
    assert_eq!(told.len(), 5000 - 1024);
    let mut stage = Stage::new();
    for number in 0..200 {
        stage.come("evil", &number.to_string(), "x");
    }
    assert_eq!(stage.queue.late(stage.now).len(), 200 - 128);
    stage.pass(2000);
    assert_eq!(stage.queue.late(stage.now).len(), 128);
    assert_eq!(stage.queue.due(stage.now), None);
    // The pair of a connection that has ended is not checked.
    let gone = stage.come("evil", "tool", "x");
    stage.queue.forget(gone);
    assert_eq!(stage.queue.next(stage.now), None);
}

#[test]
fn results_of_an_older_file_are_checked_again() {
    let mut stage = Stage::new();
    let link = stage.come("lab", "tool", "x");
    let (pair, _) = stage.queue.next(stage.now).unwrap();
    stage.queue.repeat(&pair, stage.now);
    assert_eq!(stage.queue.next(stage.now), Some((pair, link)));
}

fn users(lines: &[String]) -> Users {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("users");
    std::fs::write(&path, format!("# ours\n{}\n", lines.join("\n"))).unwrap();
    Users::read(&path).unwrap()
}

fn pbkdf2(iterations: u32) -> String {
    hash_for_mosquitto("battery", std::num::NonZeroU32::new(iterations).unwrap()).unwrap()
}

/// Asks until there is an answer.
fn verdict(passwords: &mut Passwords, user: &str, password: &str) -> Verdict {
    let begin = Instant::now();
    if let Some(verdict) = passwords.ask(7, "lab", user, password.as_bytes(), begin) {
        return verdict;
    }
    loop {
        let credentials = |_| Some((user.to_owned(), password.as_bytes().to_owned()));
        if let Some((link, verdict)) = passwords.verdicts(Instant::now(), credentials).pop() {
            assert_eq!(link, 7);
            return verdict;
        }
        assert!(begin.elapsed() < Duration::from_secs(20));
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn right_ones_are_admitted_and_others_are_not() {
    let lab = format!("lab:{}", hash_password("correct horse").unwrap());
    let ada = format!("ada:{}", pbkdf2(1000));
    let mut passwords = Passwords::new(users(&[lab.clone(), ada])).unwrap();
    for _ in 0..2 {
        assert_eq!(
            verdict(&mut passwords, "lab", "correct horse"),
            Verdict::Admitted
        );
        assert_eq!(verdict(&mut passwords, "ada", "battery"), Verdict::Admitted);
    }
    for (user, password) in [
        ("lab", "correct hors"),
        ("la", "bcorrect horse"),
        ("eve", "battery"),
    ] {
        assert_eq!(verdict(&mut passwords, user, password), Verdict::Wrong);
    }
    // Ada is removed; the other account stays, and is accepted without another check.
    passwords.replace(users(&[lab]));
    assert_eq!(verdict(&mut passwords, "ada", "battery"), Verdict::Wrong);
    let known = passwords.ask(7, "lab", "lab", b"correct horse", Instant::now());
    assert_eq!(known, Some(Verdict::Admitted));
}

/// Returns the processor time of this thread in seconds.
fn processor_time() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    #[expect(clippy::cast_precision_loss, reason = "a test takes seconds")]
    {
        now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
    }
}

#[test]
fn response_times_do_not_reveal_which_accounts_exist() {
    let users = users(&[
        format!("argon:{}", hash_password("correct horse").unwrap()),
        format!("old:{}", pbkdf2(5000)),
        format!("new:{}", pbkdf2(40_000)),
    ]);
    let mut least = [f64::MAX; 4];
    // Take turns, and measure this thread's own time, so that other load on the machine affects all of them equally.
    for _ in 0..15 {
        for (user, least) in ["argon", "old", "new", "absent"].iter().zip(&mut least) {
            let begin = processor_time();
            assert!(!users.admit(user, b"guess"));
            *least = least.min(processor_time() - begin);
        }
    }
    let (fastest, slowest) = least
        .iter()
        .fold((f64::MAX, 0.0f64), |(fastest, slowest), &one| {
            (fastest.min(one), slowest.max(one))
        });
    assert!(slowest < 1.4 * fastest, "{least:?}");
}

#[test]
fn what_is_wrong_names_file_and_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("users");
    for (text, wrong) in [
        ("\nlab:correct horse\n", "line 2"),
        ("lab\n", "line 1"),
        (":$7$1$c2FsdA==$aGFzaA==\n", "line 1"),
    ] {
        std::fs::write(&path, text).unwrap();
        let message = Users::read(&path).err().unwrap().to_string();
        assert!(
            message.contains(wrong) && message.contains("--add-user"),
            "{message}"
        );
        assert!(!message.contains("correct horse"), "{message}");
    }
}

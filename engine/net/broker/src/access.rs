//! The access file, in Mosquitto's format: which clients may read and write which topics.
//!
//! ```text
//! topic read public/#             all clients without a user name
//! user ada
//! topic readwrite swarm/#         read, write, readwrite (default) or deny
//! pattern write tools/%u/%c       all clients; %u = user name, %c = client identifier
//! ```

use crate::{BrokerError, lines};
use std::path::Path;
use swarmwright_packets::topic;

/// Access rules; everything that no rule allows is denied.
pub struct Access {
    rules: Vec<Rule>,
}

struct Rule {
    who: Who,
    read: bool,
    write: bool,
    filter: Box<str>,
}

enum Who {
    Anonymous,
    User(Box<str>),
    Pattern,
}

/// The client whose access is checked.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    pub user: Option<&'a str>,
    pub client_id: &'a str,
}

impl Access {
    /// Reads an access file.
    pub fn read(path: &Path) -> Result<Self, BrokerError> {
        let mut rules = Vec::new();
        let mut user: Option<Box<str>> = None;
        lines::each(path, "access file", |line| {
            let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
            let rest = rest.trim();
            let audience = match word {
                "user" if !rest.is_empty() => {
                    user = Some(rest.into());
                    return Ok(());
                }
                "topic" => user.clone().map_or(Who::Anonymous, Who::User),
                "pattern" => Who::Pattern,
                _ => return Err("expected `user NAME`, `topic [read|write|readwrite|deny] FILTER` or `pattern ...`".into()),
            };
            let (right, filter) = match rest.split_once(char::is_whitespace) {
                Some((right @ ("read" | "write" | "readwrite" | "deny"), filter)) => {
                    (right, filter.trim())
                }
                // As in Mosquitto: a misspelt right must not become a rule that allows everything.
                Some((right, _)) => {
                    return Err(format!(
                        "`{right}` is not a right; expected read, write, readwrite or deny, which must stand before a filter \
                         with blanks"
                    ));
                }
                None => ("readwrite", rest),
            };
            if !topic::is_filter(filter) {
                return Err(format!("`{filter}` is not a valid topic filter"));
            }
            let (read, write) = match right {
                "read" => (true, false),
                "write" => (false, true),
                "deny" => (false, false),
                _ => (true, true),
            };
            rules.push(Rule {
                who: audience,
                read,
                write,
                filter: filter.into(),
            });
            Ok(())
        })?;
        Ok(Self { rules })
    }

    /// Returns whether the subject may receive messages on this topic.
    pub fn may_read(&self, subject: Subject<'_>, name: &str) -> bool {
        self.allows(subject, name, |rule| rule.read)
    }

    /// Returns whether the subject may publish to this topic.
    pub fn may_write(&self, subject: Subject<'_>, name: &str) -> bool {
        self.allows(subject, name, |rule| rule.write)
    }

    fn allows(&self, subject: Subject<'_>, name: &str, right: impl Fn(&Rule) -> bool) -> bool {
        let mut allowed = false;
        for rule in self
            .rules
            .iter()
            .filter(|rule| rule.concerns(subject, name))
        {
            if !rule.read && !rule.write {
                return false;
            }
            allowed |= right(rule);
        }
        allowed
    }
}

impl Rule {
    fn concerns(&self, subject: Subject<'_>, name: &str) -> bool {
        match &self.who {
            Who::Anonymous => subject.user.is_none() && topic::matches(&self.filter, name),
            Who::User(user) => subject.user == Some(user) && topic::matches(&self.filter, name),
            Who::Pattern => {
                // A name with wildcards or slashes would reach beyond its own part of the tree.
                let user = subject.user.unwrap_or("");
                if [user, subject.client_id]
                    .iter()
                    .any(|part| part.contains(['+', '#', '/']))
                {
                    return false;
                }
                let filter = self
                    .filter
                    .replace("%u", user)
                    .replace("%c", subject.client_id);
                topic::matches(&filter, name)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn subject<'a>(user: Option<&'a str>, client_id: &'a str) -> Subject<'a> {
        Subject { user, client_id }
    }

    #[test]
    fn rules_by_user_pattern_and_denial() {
        let access = Access::read(Path::new("tests/data/access")).unwrap();
        let (ada, bob, anonymous) = (
            subject(Some("ada"), "tool"),
            subject(Some("bob"), "tool"),
            subject(None, "x"),
        );
        assert!(access.may_write(ada, "swarm/sensor") && access.may_read(ada, "swarm/sensor"));
        assert!(!access.may_read(ada, "swarm/secret"));
        assert!(access.may_read(bob, "swarm/sensor") && !access.may_write(bob, "swarm/sensor"));
        assert!(
            access.may_read(anonymous, "public/news")
                && !access.may_write(anonymous, "public/news")
        );
        assert!(!access.may_read(anonymous, "swarm/sensor"));
        assert!(
            access.may_write(bob, "tools/bob/tool") && !access.may_write(bob, "tools/ada/tool")
        );
        assert!(!access.may_write(subject(Some("#"), "tool"), "tools/ada/tool"));
    }

    #[test]
    fn mistyped_rights_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("acl");
        let read = |text: &str| {
            std::fs::write(&file, text).unwrap();
            Access::read(&file).map_err(|error| error.to_string())
        };
        for right in ["denny", "Deny", "raed", "banana"] {
            let Err(wrong) = read(&format!(
                "user tool\ntopic readwrite #\ntopic {right} secret/#\n"
            )) else {
                panic!("{right} is accepted");
            };
            assert!(wrong.contains("acl, line 3: "), "{wrong}");
            assert!(
                wrong.contains(&format!("`{right}` is not a right")),
                "{wrong}"
            );
        }
        let access = read("user tool\ntopic readwrite two words/#\ntopic plain/#\n").unwrap();
        let tool = subject(Some("tool"), "x");
        assert!(access.may_write(tool, "two words/a") && access.may_read(tool, "plain/a"));
    }
}

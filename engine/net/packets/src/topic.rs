//! Topic names and topic filters: MQTT 5.0, chapter 4.7.

/// Returns whether this is a valid topic name for publishing.
pub fn is_name(topic: &str) -> bool {
    !topic.is_empty() && !topic.bytes().any(|byte| matches!(byte, b'+' | b'#'))
}

/// Returns whether this is a valid topic filter: `#` only as the last level, `+` only as a whole level.
pub fn is_filter(filter: &str) -> bool {
    let mut levels = filter.split('/').peekable();
    if filter.is_empty() {
        return false;
    }
    while let Some(level) = levels.next() {
        let fits = match level {
            "#" => levels.peek().is_none(),
            "+" => true,
            _ => !level.contains(['+', '#']),
        };
        if !fits {
            return false;
        }
    }
    true
}

/// Returns whether a valid filter matches the topic name. Topics that start with `$` only match filters that do, too.
pub fn matches(filter: &str, topic: &str) -> bool {
    if filter == topic {
        return true;
    }
    if topic.starts_with('$') && filter.starts_with(['+', '#']) {
        return false;
    }
    let mut levels = topic.split('/');
    for pattern in filter.split('/') {
        // `a/#` matches `a` as well.
        if pattern == "#" {
            return true;
        }
        match levels.next() {
            Some(level) if pattern == "+" || pattern == level => {}
            _ => return false,
        }
    }
    levels.next().is_none()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_examples_of_the_standard() {
        for (filter, topic, expected) in [
            ("sport/tennis/player1/#", "sport/tennis/player1", true),
            (
                "sport/tennis/player1/#",
                "sport/tennis/player1/score/wimbledon",
                true,
            ),
            ("sport/#", "sport", true),
            ("#", "a/b", true),
            ("sport/tennis/+", "sport/tennis/player1", true),
            ("sport/tennis/+", "sport/tennis/player1/ranking", false),
            ("sport/+", "sport", false),
            ("sport/+", "sport/", true),
            ("+/+", "/finance", true),
            ("/+", "/finance", true),
            ("+", "/finance", false),
            ("#", "$SYS/uptime", false),
            ("+/monitor/Clients", "$SYS/monitor/Clients", false),
            ("$SYS/#", "$SYS/uptime", true),
        ] {
            assert!(is_filter(filter) && is_name(topic));
            assert_eq!(matches(filter, topic), expected, "{filter} on {topic}");
        }
        for wrong in [
            "",
            "sport/tennis#",
            "sport/tennis/#/ranking",
            "sport+",
            "a/b+/c",
        ] {
            assert!(!is_filter(wrong), "{wrong}");
        }
    }

    proptest! {
        #[test]
        fn a_filter_made_from_a_topic_covers_it(levels in prop::collection::vec("[a-z]{0,3}", 1..5), cut in 0usize..6, plus in 0usize..5) {
            let topic = levels.join("/");
            prop_assume!(is_name(&topic));
            let mut filter = levels.clone();
            if plus < filter.len() {
                filter[plus] = "+".into();
            }
            if cut <= filter.len() {
                filter.truncate(cut);
                filter.push("#".into());
            }
            let filter = filter.join("/");
            prop_assert!(is_filter(&filter));
            prop_assert!(matches(&filter, &topic));
        }

        #[test]
        fn a_longer_topic_needs_a_multi_level_wildcard(levels in prop::collection::vec("[a-z]{1,3}", 1..5)) {
            let topic = levels.join("/");
            let longer = format!("{topic}/x");
            prop_assert!(!matches(&topic, &longer));
            prop_assert!(!matches(&longer, &topic));
        }
    }
}

//! Known names that are like one that was found.

/// Names that are at least so like another one, 0 to 1, are suggested.
const LIKE: f64 = 0.8;

/// `; did you mean "camera"?` for the known name that is most like `name`, or nothing where none is.
#[must_use]
pub fn did_you_mean<'a>(name: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    let folded = name.to_lowercase();
    let like = |candidate: &str| strsim::jaro_winkler(&folded, &candidate.to_lowercase());
    let scores = names
        .into_iter()
        .map(|candidate| (candidate, like(candidate)));
    let nearest = scores.fold(
        ("", 0.0),
        |best, next| if next.1 > best.1 { next } else { best },
    );
    match nearest {
        (candidate, like) if like >= LIKE => format!("; did you mean {candidate:?}?"),
        _ => String::new(),
    }
}

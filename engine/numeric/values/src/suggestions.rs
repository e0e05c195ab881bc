//! Known names that are like one that was found.

/// Names that are at least so like another one, 0 to 1, are suggested.
const LIKE: f64 = 0.8;

/// `; did you mean "camera"?` for the known name that is most like `name`, or nothing where none is.
#[must_use]
pub fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    let folded = name.to_lowercase();
    let like = |known: &str| strsim::jaro_winkler(&folded, &known.to_lowercase());
    let known = known.into_iter().map(|known| (known, like(known)));
    let nearest = known.fold(
        ("", 0.0),
        |best, next| if next.1 > best.1 { next } else { best },
    );
    match nearest {
        (known, like) if like >= LIKE => format!("; did you mean {known:?}?"),
        _ => String::new(),
    }
}

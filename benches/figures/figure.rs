//! One figure: a value that this run computed, beside what it must be.

/// What a value must be.
#[derive(Clone, Copy)]
pub(crate) enum Target {
    AtLeast(f64),
    AtMost(f64),
    None,
}

/// Prints one figure.
pub(crate) fn figure(name: &str, value: f64, unit: &str, target: Target) {
    let round = |value: f64| (value * 1e4).round() / 1e4;
    let (wanted, holds) = match target {
        Target::AtLeast(bound) => (format!(">={}", round(bound)), value >= bound),
        Target::AtMost(bound) => (format!("<={}", round(bound)), value <= bound),
        Target::None => ("-".to_owned(), true),
    };
    let verdict = if holds { "ok" } else { "short" };
    println!("figure {name} {} {unit} {wanted} {verdict}", round(value));
}

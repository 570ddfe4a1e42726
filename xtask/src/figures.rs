//! Compares printed figures with a list, as tests/figures is.
//!
//! A line of the list is the name of a figure, or a name and a bound (`<=1.4`, `>=40`) for one that may miss its target, but
//! not this bound. Figures that fall short, are missing, or are not listed are errors.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::tools::{Outcome, read};

/// Whether the commands printed all listed figures, and good enough ones.
pub(crate) fn hold(printed: &Path, list: &Path) -> Outcome {
    let printed =
        std::fs::read_to_string(printed).map_err(|error| format!("{}: {error}", printed.display()))?;
    let faults = faults(&read(list)?, &printed);
    faults.iter().for_each(|fault| eprintln!("{fault}"));
    if faults.is_empty() {
        Ok(())
    } else {
        Err(format!("{} figures are not as {} wants", faults.len(), list.display()))
    }
}

fn faults(list: &str, printed: &str) -> Vec<String> {
    let mut expected = BTreeMap::new();
    for line in list.lines() {
        let mut words = line.split('#').next().unwrap_or_default().split_whitespace();
        if let Some(name) = words.next() {
            expected.insert(name, words.next().unwrap_or_default());
        }
    }
    let mut seen = BTreeSet::new();
    let mut faults = Vec::new();
    for line in printed.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let ["figure", name, value, .., verdict] = words[..] else { continue };
        seen.insert(name);
        let Some(bound) = expected.get(name) else {
            faults.push(format!("not listed: {line}"));
            continue;
        };
        if verdict == "short" && !within(value, bound) {
            let of = if bound.is_empty() { String::new() } else { format!(" of {bound}") };
            faults.push(format!("falls short{of}: {line}"));
        }
    }
    let missing = expected.keys().filter(|name| !seen.contains(*name));
    faults.extend(missing.map(|name| format!("not printed: {name}")));
    faults
}

fn within(value: &str, bound: &str) -> bool {
    let Ok(value) = value.parse::<f64>() else { return false };
    let most = bound.strip_prefix("<=").and_then(|most| most.parse::<f64>().ok());
    let least = bound.strip_prefix(">=").and_then(|least| least.parse::<f64>().ok());
    most.is_some_and(|most| value <= most) || least.is_some_and(|least| value >= least)
}

#[cfg(test)]
mod tests {
    use super::faults;

    #[test]
    fn a_figure_that_is_short_missing_or_unknown_is_named() {
        let list = "good # a remark\nbounded <=1.4\nfloor >=40\nworse <=1.4\nshort\nmissing\n";
        let printed = "figure good 1 x <=2 ok\nfigure bounded 1.4 x <=1 short\nfigure floor 41 x >=50 short\nsome text\n\
                       figure worse 1.5 x <=1 short\nfigure short 3 x <=1 short\nfigure new 1 x - ok\n";
        assert_eq!(
            faults(list, printed),
            [
                "falls short of <=1.4: figure worse 1.5 x <=1 short",
                "falls short: figure short 3 x <=1 short",
                "not listed: figure new 1 x - ok",
                "not printed: missing",
            ]
        );
    }
}

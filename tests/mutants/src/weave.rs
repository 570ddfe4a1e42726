//! Puts all changes of a file into it, each behind a switch: `if on(17) { changed } else { original }`.

use std::ops::Range;

use crate::find::{Kind, Site};

/// Where in the mutated text a mutant stands; more than one where a whole place is meant.
pub(crate) struct Span {
    pub(crate) range: Range<usize>,
    pub(crate) mutants: Range<u32>,
}

/// The mutated text, and where its mutants are, whose numbers go up from `first` in the order of `sites`.
pub(crate) fn weave(text: &str, sites: &[Site], first: u32) -> (String, Vec<Span>) {
    // What is inserted where. At one place, ends come first, the inner one before the outer one; then beginnings, the
    // outer one first, as the sites are sorted.
    let mut insertions: Vec<(usize, bool, usize, Insertion)> = Vec::new();
    let mut id = first;
    for (index, site) in sites.iter().enumerate() {
        let mutants = id..id + site.changes.len() as u32;
        id = mutants.end;
        let wraps = matches!(site.kind, Kind::Expression | Kind::Statement);
        insertions.push((site.range.start, true, index, Insertion::Begin(site, mutants.clone())));
        if wraps {
            insertions.push((site.range.end, false, usize::MAX - index, Insertion::End(site, mutants)));
        }
    }
    insertions.sort_by_key(|(place, begins, order, _)| (*place, *begins, *order));
    let mut woven = Woven { text: String::new(), spans: Vec::new(), open: Vec::new() };
    let mut done = 0;
    for (place, _, _, insertion) in insertions {
        woven.text.push_str(&text[done..place]);
        done = place;
        match insertion {
            Insertion::Begin(site, mutants) => woven.begin(site, mutants),
            Insertion::End(site, mutants) => woven.end(site, mutants),
        }
    }
    woven.text.push_str(&text[done..]);
    (woven.text, woven.spans)
}

enum Insertion<'s> {
    Begin(&'s Site, Range<u32>),
    End(&'s Site, Range<u32>),
}

struct Woven {
    text: String,
    spans: Vec<Span>,
    /// Where the places began that have not ended yet.
    open: Vec<usize>,
}

impl Woven {
    fn begin(&mut self, site: &Site, mutants: Range<u32>) {
        let start = self.text.len();
        match site.kind {
            Kind::Expression => {
                self.open.push(start);
                self.text.push('(');
                for (id, change) in mutants.zip(&site.changes) {
                    self.switch(id, "if ", &format!("{{ {} }} else ", change.text));
                }
                self.text.push_str("{ ");
            }
            Kind::Statement => {
                self.open.push(start);
                self.text.push_str(&format!("if !::mutant_switch::on({}) {{ ", mutants.start));
            }
            Kind::Body => {
                for (id, change) in mutants.zip(&site.changes) {
                    self.switch(id, "if ", &format!("{{ return {}; }} ", change.text));
                }
            }
            Kind::Arm => self.switch(mutants.start, " if !", ""),
        }
    }

    fn end(&mut self, site: &Site, mutants: Range<u32>) {
        self.text.push_str(if site.kind == Kind::Expression { " })" } else { " }" });
        let start = self.open.pop().expect("each place begins before it ends");
        self.spans.push(Span { range: start..self.text.len(), mutants });
    }

    fn switch(&mut self, id: u32, before: &str, behind: &str) {
        let start = self.text.len();
        self.text.push_str(&format!("{before}::mutant_switch::on({id}) {behind}"));
        self.spans.push(Span { range: start..self.text.len(), mutants: id..id + 1 });
    }
}

#[cfg(test)]
mod tests {
    use super::weave;
    use crate::find::sites;

    #[test]
    fn every_change_is_behind_a_switch_of_its_own_and_the_original_is_still_there() {
        let text = "fn f() { if a < 1 { b(); } }";
        let (woven, spans) = weave(text, &sites(text).unwrap(), 1);
        let on = "::mutant_switch::on";
        let number = format!("(if {on}(5) {{ 2 }} else if {on}(6) {{ 0 }} else {{ 1 }})");
        let condition = format!(
            "(if {on}(2) {{ true }} else if {on}(3) {{ false }} else if {on}(4) {{ a <= 1 }} else {{ a < {number} }})"
        );
        let body = format!("if {condition} {{ if !{on}(7) {{ b(); }} }}");
        assert_eq!(woven, format!("fn f() {{if {on}(1) {{ return ; }}  {body} }}"));
        let smallest = |place: &str| {
            let at = woven.find(place).unwrap();
            let around = spans.iter().filter(|span| span.range.contains(&at));
            around.min_by_key(|span| span.range.len()).unwrap().mutants.clone()
        };
        assert_eq!((smallest("a <= 1"), smallest("a < "), smallest("b();")), (4..5, 2..5, 7..8));
    }
}

//! Finds what can be changed in a file: small changes that keep the types.

use std::collections::HashSet;
use std::ops::Range;

use proc_macro2::Span;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{
    Arm, Attribute, BinOp, Block, Expr, ExprBinary, ExprCall, ExprIf, ExprLit, ExprMacro, ExprMatch,
    ExprMethodCall, ExprRepeat, ExprUnary, ExprWhile, ImplItem, Item, Lit, Pat, ReturnType, Signature, Stmt,
    TraitItem, Type, UnOp,
};

use crate::scope::FEATURES;

pub(crate) struct Change {
    /// What is there instead, or what is returned.
    pub(crate) text: String,
    /// For people.
    pub(crate) words: String,
}

/// How a changed place is woven into the text.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// The expression has another text.
    Expression,
    /// The statement is left out.
    Statement,
    /// The function returns at once; the place is behind the brace that opens its body.
    Body,
    /// The arm of a match is left out; the place is behind its pattern.
    Arm,
}

/// A place with its changes.
pub(crate) struct Site {
    pub(crate) kind: Kind,
    pub(crate) range: Range<usize>,
    pub(crate) line: usize,
    pub(crate) changes: Vec<Change>,
}

/// The places of one file in the order of the text, outer ones first.
pub(crate) fn sites(text: &str) -> syn::Result<Vec<Site>> {
    let file = syn::parse_file(text)?;
    let mut finder = Finder { text, sites: Vec::new(), decided: HashSet::new() };
    finder.visit_file(&file);
    let mut sites = finder.sites;
    sites.sort_by_key(|site| (site.range.start, usize::MAX - site.range.end));
    sites.dedup_by(|again, first| {
        let same = again.range == first.range && again.kind == first.kind;
        if same {
            first.changes.append(&mut again.changes);
        }
        same
    });
    Ok(sites)
}

struct Finder<'t> {
    text: &'t str,
    sites: Vec<Site>,
    /// Whole conditions, which are tried as `true` and as `false`: their opposite would show nothing new.
    decided: HashSet<Range<usize>>,
}

impl<'t> Finder<'t> {
    fn source(&self, span: Span) -> &'t str {
        &self.text[span.byte_range()]
    }

    fn add(&mut self, kind: Kind, span: Span, range: Range<usize>, text: String, words: String) {
        let changes = vec![Change { text, words }];
        self.sites.push(Site { kind, range, line: span.start().line, changes });
    }

    /// `span` is an expression; `text` is what it becomes.
    fn replace(&mut self, span: Span, text: impl Into<String>) {
        let text = text.into();
        let words = format!("`{}` to `{}`", short(self.source(span)), short(&text));
        self.add(Kind::Expression, span, span.byte_range(), text, words);
    }

    /// The same expression with `part` of it written differently.
    fn replace_part(&mut self, whole: Span, part: Span, by: &str) {
        let (whole_range, part) = (whole.byte_range(), part.byte_range());
        let before = &self.text[whole_range.start..part.start];
        let behind = &self.text[part.end..whole_range.end];
        self.replace(whole, format!("{before}{by}{behind}"));
    }

    fn leave_out(&mut self, span: Span) {
        let words = format!("without `{}`", short(self.source(span)));
        self.add(Kind::Statement, span, span.byte_range(), String::new(), words);
    }

    /// Tries a condition both ways; in a chain with `let`, each of its other parts.
    fn decide(&mut self, condition: &Expr, values: &[&str]) {
        match condition {
            Expr::Let(_) => {}
            Expr::Binary(ExprBinary { left, op: BinOp::And(_), right, .. }) if has_let(condition) => {
                self.decide(left, values);
                self.decide(right, values);
            }
            Expr::Lit(_) => {}
            condition if is_feature(condition) => self.replace(condition.span(), "false"),
            _ => {
                self.decided.insert(condition.span().byte_range());
                values.iter().for_each(|value| self.replace(condition.span(), *value));
            }
        }
    }

    fn is_decided(&self, span: Span) -> bool {
        self.decided.contains(&span.byte_range())
    }

    fn function(&mut self, signature: &Signature, block: &Block) {
        let inside = block.brace_token.span.open().byte_range().end;
        let place = inside..inside;
        for &value in self.values(&signature.output) {
            let only = block.stmts.first().filter(|_| block.stmts.len() < 2);
            if block.stmts.is_empty() || only.is_some_and(|only| self.source(only.span()) == value) {
                continue;
            }
            let words = format!("`{}` is `return {value};`", signature.ident).replace(" ;", ";");
            self.add(Kind::Body, signature.ident.span(), place.clone(), value.to_owned(), words);
        }
        if let (ReturnType::Default, Some(Stmt::Expr(last, None))) = (&signature.output, block.stmts.last())
            && block.stmts.len() > 1
        {
            self.call(last, last.span());
        }
    }

    /// What a function may return instead of what it computes.
    fn values(&self, output: &ReturnType) -> &'static [&'static str] {
        let ReturnType::Type(_, of) = output else { return &[""] };
        let Type::Path(path) = &**of else { return &[] };
        let Some(last) = path.path.segments.last() else { return &[] };
        match last.ident.to_string().as_str() {
            "bool" => &["true", "false"],
            "Option" => &["None"],
            "Result" if self.source(of.span()).starts_with("Result<()") => &["Ok(())"],
            "Result" if last.arguments.is_empty() => &["Ok(())"],
            "u8" | "u16" | "u32" | "u64" | "usize" | "i16" | "i32" => &["0", "1"],
            _ => &[],
        }
    }

    /// Whether it computes and assigns, such as `+=`.
    fn assigns(&self, op: &BinOp) -> bool {
        let computes = self.source(op.span()).strip_suffix('=');
        computes.is_some_and(|computes| !["<", ">", "=", "!"].contains(&computes))
    }

    /// A statement that calls or assigns may be left out; `span` has its semicolon.
    fn call(&mut self, expression: &Expr, span: Span) {
        let acts = match expression {
            Expr::Call(_) | Expr::MethodCall(_) | Expr::Await(_) | Expr::Assign(_) | Expr::Try(_) => true,
            Expr::Binary(binary) => self.assigns(&binary.op),
            _ => false,
        };
        if acts {
            self.leave_out(span);
        }
    }
}

impl<'ast> Visit<'ast> for Finder<'_> {
    fn visit_item(&mut self, item: &'ast Item) {
        let attributes = match item {
            Item::Fn(item) => &item.attrs,
            Item::Impl(item) => &item.attrs,
            Item::Mod(item) => &item.attrs,
            Item::Trait(item) => &item.attrs,
            // Types, constants, imports: nothing runs.
            _ => return,
        };
        if built(attributes) {
            if let Item::Fn(item) = item {
                self.function(&item.sig, &item.block);
            }
            visit::visit_item(self, item);
        }
    }

    fn visit_impl_item(&mut self, item: &'ast ImplItem) {
        if let ImplItem::Fn(method) = item
            && built(&method.attrs)
        {
            self.function(&method.sig, &method.block);
            visit::visit_impl_item(self, item);
        }
    }

    fn visit_trait_item(&mut self, item: &'ast TraitItem) {
        if let TraitItem::Fn(method) = item
            && let Some(block) = &method.default
        {
            self.function(&method.sig, block);
            visit::visit_trait_item(self, item);
        }
    }

    // What the compiler computes, and what it needs to know, stays as it is.
    fn visit_type(&mut self, _: &'ast Type) {}
    fn visit_pat(&mut self, _: &'ast Pat) {}
    fn visit_attribute(&mut self, _: &'ast Attribute) {}
    fn visit_generic_argument(&mut self, _: &'ast syn::GenericArgument) {}
    fn visit_expr_const(&mut self, _: &'ast syn::ExprConst) {}

    fn visit_expr_repeat(&mut self, repeat: &'ast ExprRepeat) {
        if !matches!(*repeat.expr, Expr::Lit(_)) {
            self.visit_expr(&repeat.expr);
        }
    }

    fn visit_stmt(&mut self, statement: &'ast Stmt) {
        match statement {
            Stmt::Expr(expression, Some(_)) => self.call(expression, statement.span()),
            Stmt::Local(local) if !built(&local.attrs) => return,
            Stmt::Local(local) if matches!(local.pat, Pat::Wild(_)) => self.leave_out(statement.span()),
            _ => {}
        }
        visit::visit_stmt(self, statement);
    }

    fn visit_expr_if(&mut self, expression: &'ast ExprIf) {
        self.decide(&expression.cond, &["true", "false"]);
        if is_feature(&expression.cond) {
            // What is built without it stands behind `else`.
            return self.visit_block(&expression.then_branch);
        }
        visit::visit_expr_if(self, expression);
    }

    fn visit_expr_while(&mut self, expression: &'ast ExprWhile) {
        self.decide(&expression.cond, &["false"]);
        visit::visit_expr_while(self, expression);
    }

    fn visit_expr_match(&mut self, expression: &'ast ExprMatch) {
        let rest =
            expression.arms.last().filter(|arm| arm.guard.is_none() && matches!(arm.pat, Pat::Wild(_)));
        if let Some(rest) = rest {
            let instead = self.source(rest.body.span());
            for arm in &expression.arms[..expression.arms.len() - 1] {
                if arm.guard.is_none() && self.source(arm.body.span()) != instead {
                    let end = arm.pat.span().byte_range().end;
                    let words = format!("without the arm `{}`", short(self.source(arm.pat.span())));
                    self.add(Kind::Arm, arm.pat.span(), end..end, String::new(), words);
                }
            }
        }
        visit::visit_expr_match(self, expression);
    }

    fn visit_arm(&mut self, arm: &'ast Arm) {
        if !built(&arm.attrs) {
            return;
        }
        if let Some((_, guard)) = &arm.guard {
            self.decide(guard, &["true", "false"]);
        }
        let assigns = match &*arm.body {
            Expr::Assign(_) => true,
            Expr::Binary(binary) => self.assigns(&binary.op),
            _ => false,
        };
        if assigns {
            self.replace(arm.body.span(), "()");
        }
        visit::visit_arm(self, arm);
    }

    fn visit_expr_binary(&mut self, binary: &'ast ExprBinary) {
        let whole = binary.span();
        match &binary.op {
            BinOp::And(_) | BinOp::Or(_) if !has_let(&binary.left) && !has_let(&binary.right) => {
                // Without the right one, without the left one; a longer chain is shortened one by one.
                self.replace(whole, self.source(binary.left.span()));
                let chain = matches!(&*binary.left, Expr::Binary(left) if same_logic(&left.op, &binary.op));
                if !chain && !is_feature(&binary.left) {
                    self.replace(whole, self.source(binary.right.span()));
                }
            }
            BinOp::Eq(_) | BinOp::Ne(_) if self.is_decided(whole) => {}
            op => {
                if let Some(other) = swapped(self.source(op.span())) {
                    self.replace_part(whole, op.span(), &other);
                }
            }
        }
        visit::visit_expr_binary(self, binary);
    }

    fn visit_expr_unary(&mut self, unary: &'ast ExprUnary) {
        if matches!(unary.op, UnOp::Not(_)) && !self.is_decided(unary.span()) {
            self.replace(unary.span(), self.source(unary.expr.span()));
        }
        visit::visit_expr_unary(self, unary);
    }

    fn visit_expr_lit(&mut self, literal: &'ast ExprLit) {
        match &literal.lit {
            Lit::Bool(flag) => self.replace(flag.span, (!flag.value).to_string()),
            Lit::Int(number) => {
                let Ok(value) = number.base10_parse::<u64>() else { return };
                let around = [value.checked_add(1), value.checked_sub(1)];
                around.into_iter().flatten().for_each(|near| {
                    self.replace(number.span(), format!("{near}{}", number.suffix()));
                });
            }
            _ => {}
        }
    }

    fn visit_expr_call(&mut self, call: &'ast ExprCall) {
        if let (Expr::Path(path), Some(Expr::Lit(ExprLit { lit: Lit::Int(number), .. }))) =
            (&*call.func, call.args.first())
            && path.path.segments.last().is_some_and(|last| last.ident.to_string().starts_with("from_"))
            && let Ok(value) = number.base10_parse::<u64>()
        {
            // A time that is a little longer is no fault.
            return self.replace(number.span(), (value * 2 + 1).to_string());
        }
        visit::visit_expr_call(self, call);
    }

    fn visit_expr_method_call(&mut self, call: &'ast ExprMethodCall) {
        let whole = Expr::MethodCall(call.clone()).span();
        if let Some(other) = other(METHODS, &call.method.to_string())
            && !self.is_decided(whole)
        {
            self.replace_part(whole, call.method.span(), other);
        }
        visit::visit_expr_method_call(self, call);
    }

    fn visit_expr_macro(&mut self, expression: &'ast ExprMacro) {
        let span = expression.span();
        if expression.mac.path.is_ident("matches") && !self.is_decided(span) {
            self.replace(span, format!("!{}", self.source(span)));
        }
    }
}

/// Binary operators and methods of which one is a small slip away from the other.
const OPERATORS: &str = "<:<= >:>= ==:!= +:- *:/ &:| <<:>> %:* ^:&";
const METHODS: &str = "min:max is_some:is_none is_ok:is_err any:all wrapping_add:wrapping_sub \
                       saturating_add:saturating_sub checked_add:checked_sub";

/// The other one of the first of these pairs that has `one`.
fn other(pairs: &'static str, one: &str) -> Option<&'static str> {
    pairs.split(' ').filter_map(|pair| pair.split_once(':')).find_map(|(first, second)| match one {
        _ if one == first => Some(second),
        _ => (one == second).then_some(first),
    })
}

/// The operator that is a small slip away, also of one that assigns.
fn swapped(operator: &str) -> Option<String> {
    let assigning = || Some(other(OPERATORS, operator.strip_suffix('=')?)?.to_owned() + "=");
    other(OPERATORS, operator).map(str::to_owned).or_else(assigning)
}

fn same_logic(one: &BinOp, other: &BinOp) -> bool {
    matches!((one, other), (BinOp::And(_), BinOp::And(_)) | (BinOp::Or(_), BinOp::Or(_)))
}

fn has_let(expression: &Expr) -> bool {
    match expression {
        Expr::Let(_) => true,
        Expr::Binary(ExprBinary { left, op: BinOp::And(_), right, .. }) => has_let(left) || has_let(right),
        _ => false,
    }
}

/// Whether it is a constant that says that a feature is on, which is so in the mutated build.
fn is_feature(expression: &Expr) -> bool {
    let Expr::Path(path) = expression else { return false };
    path.path.get_ident().is_some_and(|name| !name.to_string().contains(char::is_lowercase))
}

/// Whether what has these attributes is part of the mutated build and no test.
fn built(attributes: &[Attribute]) -> bool {
    attributes.iter().all(|attribute| {
        if attribute.path().is_ident("test") {
            return false;
        }
        if !attribute.path().is_ident("cfg") {
            return true;
        }
        attribute.parse_args::<syn::MetaNameValue>().is_ok_and(|condition| {
            let value = match &condition.value {
                Expr::Lit(ExprLit { lit: Lit::Str(value), .. }) => value.value(),
                _ => return false,
            };
            condition.path.is_ident("feature") && FEATURES.contains(&value.as_str())
        })
    })
}

/// One line of at most so many characters.
fn short(text: &str) -> String {
    const CHARACTERS: usize = 100;
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    match line.char_indices().nth(CHARACTERS) {
        Some((end, _)) => format!("{}...", &line[..end]),
        None => line,
    }
}

#[cfg(test)]
mod tests {
    use super::sites;

    /// The changes of a function with this body.
    fn changes(body: &str) -> Vec<String> {
        let sites = sites(&format!("fn f(a: u8, b: u8) -> char {{ {body} }}")).unwrap();
        sites.into_iter().flat_map(|site| site.changes).map(|change| change.words).collect()
    }

    #[test]
    fn a_condition_is_tried_both_ways_and_at_its_border() {
        let expected = ["`a < b` to `true`", "`a < b` to `false`", "`a < b` to `a <= b`"];
        assert_eq!(changes("if a < b { x } else { y }"), expected);
        assert_eq!(changes("if a == b { x } else { y }"), ["`a == b` to `true`", "`a == b` to `false`"]);
        assert_eq!(changes("let equal = a == b; x"), ["`a == b` to `a != b`"]);
    }

    #[test]
    fn each_part_of_a_chain_is_left_out() {
        let expected = ["`a && b && c` to `a && b`", "`a && b` to `a`", "`a && b` to `b`"];
        assert_eq!(changes("let all = a && b && c; x"), expected);
        assert_eq!(changes("if let Some(c) = d && e { x } else { y }"), ["`e` to `true`", "`e` to `false`"]);
    }

    #[test]
    fn a_feature_of_the_build_is_on() {
        assert_eq!(
            changes("if AUDIT { c(a + b) } else { c(0) }"),
            ["`AUDIT` to `false`", "`a + b` to `a - b`"]
        );
        assert_eq!(changes("let is_told = AUDIT && b; x"), ["`AUDIT && b` to `AUDIT`"]);
    }

    #[test]
    fn numbers_are_one_too_high_and_one_too_low_and_operators_others() {
        assert_eq!(changes("c(0)"), ["`0` to `1`"]);
        assert_eq!(changes("c(7u8)"), ["`7u8` to `8u8`", "`7u8` to `6u8`"]);
        assert_eq!(changes("c(a + b)"), ["`a + b` to `a - b`"]);
        assert_eq!(changes("a.min(b)"), ["`a.min(b)` to `a.max(b)`"]);
        assert_eq!(changes("c(!a)"), ["`!a` to `a`"]);
    }

    #[test]
    fn calls_and_assignments_are_left_out_and_arms_of_a_match() {
        assert_eq!(changes("c(); a = b; x"), ["without `c();`", "without `a = b;`"]);
        let arms = changes("match a { Some(3) => x, _ => y }");
        assert_eq!(arms, ["without the arm `Some(3)`"], "patterns stay as they are");
        assert_eq!(changes("match a { Some(3) => y, _ => y }"), [""; 0], "which would be the same");
    }

    #[test]
    fn a_function_returns_at_once() {
        let words = |text| {
            let sites = sites(text).unwrap();
            sites.into_iter().flat_map(|site| site.changes).map(|change| change.words).collect::<Vec<_>>()
        };
        assert_eq!(words("fn f() -> bool { a }"), ["`f` is `return true;`", "`f` is `return false;`"]);
        assert_eq!(words("fn f() -> Option<u8> { a }"), ["`f` is `return None;`"]);
        assert_eq!(words("fn f() { a }"), ["`f` is `return;`"]);
        assert_eq!(words("fn f() -> bool { true }"), ["`f` is `return false;`", "`true` to `false`"]);
    }

    #[test]
    fn tests_constants_and_what_is_not_built_stay_as_they_are() {
        for text in [
            "const A: u8 = 1 + 2;",
            "#[cfg(test)] mod tests { fn f() { a(1); } }",
            "#[cfg(not(feature = \"points\"))] fn f() { a(1); }",
            "#[cfg(feature = \"small\")] fn f() { a(1); }",
            "fn f(a: [u8; 3]) {}",
        ] {
            assert!(sites(text).unwrap().is_empty(), "{text}");
        }
    }
}

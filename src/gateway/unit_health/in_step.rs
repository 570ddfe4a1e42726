//! Determines whether a unit is in step, and how to prove it: the rules of [`outstanding`](crate::gateway::outstanding) applied to
//! each unit.

use super::*;

impl Units<'_> {
    /// Whether no request of `id` is outstanding except, with `open`, the one whose response is expected.
    pub fn is_in_step(&self, id: u8, open: bool) -> bool {
        self.list().frozen || self.all.outstanding.is_in_step(self.port as u8, id, open)
    }

    /// The state of `unit`.
    pub fn state(&self, unit: &Unit, now: Instant) -> State {
        match unit {
            _ if unit.is_down => State::Down,
            _ if unit.held_until > now => State::Held,
            _ if !self.is_in_step(unit.id, unit.open) => State::OutOfStep,
            _ => State::Up,
        }
    }

    /// The next step for `id` when `request` is due.
    pub fn step(&mut self, id: u8, request: &[u8], care: &Care, now: Instant) -> Step {
        let port = self.port as u8;
        let shape = Shape::of_request(request);
        if self.list().frozen || self.all.outstanding.is_unique(port, id, &shape) {
            return Step::Direct;
        }
        self.set_needs_check(true);
        match care.proof {
            Proof::Auto => self.find_proof(id, request, care, now),
            Proof::Diagnostic => self.by_diagnostic(now),
            Proof::Read { kind, address, count } => {
                let ([a, b], [c, d]) = (address.to_be_bytes(), count.to_be_bytes());
                let read = [kind.read_function(), a, b, c, d];
                if self.proves(id, &read) {
                    Step::Prove(read, Purpose::Read)
                } else {
                    self.wait(id, care, now)
                }
            }
            Proof::None => self.wait(id, care, now),
        }
    }

    fn proves(&self, id: u8, read: &Read) -> bool {
        self.all.outstanding.proves(self.port as u8, id, &Shape::of_request(read))
    }

    fn by_diagnostic(&mut self, now: Instant) -> Step {
        Step::Prove(self.all.outstanding.diagnostic(now.as_ticks()), Purpose::Diagnostic)
    }

    /// Prefers function 8, until the unit is known to ignore it. It alternates with a read, which proves something if no response
    /// to an earlier request looks the same, and shows at least whether function 8 is ignored.
    fn find_proof(&mut self, id: u8, request: &[u8], care: &Care, now: Instant) -> Step {
        let Some(&Unit { reads: [first, second], ignored, by_read, tried, responds_to_diagnostics, .. }) =
            self.find(id)
        else {
            return self.by_diagnostic(now);
        };
        let shape = Shape::of_request(request);
        let asked = as_read(request).unwrap_or(NO_READ);
        // In order of preference: a read that is known to work or is due anyway; one that settles what was sent before it; one
        // whose response fits nothing sent before.
        let (mut telling, mut settling, mut proving) = (None, None, None);
        for read in [first, second, asked].into_iter().filter(|read| *read != NO_READ) {
            telling = telling.or(Some(read));
            if Shape::of_request(&read) != shape {
                settling = settling.or(Some(read));
            }
            if proving.is_none() && self.proves(id, &read) {
                proving = Some(read);
            }
        }
        let responds_to_nothing = telling.is_none() && tried >= TRIED_MAX;
        let most = if responds_to_diagnostics { IGNORED_RETRY } else { IGNORED_MAX };
        let diagnostic = ignored < most && !responds_to_nothing;
        let other = if diagnostic { settling.or(telling) } else { settling };
        match proving.or(other.filter(|_| !responds_to_diagnostics)) {
            Some(read) if by_read && !responds_to_diagnostics || !diagnostic => {
                Step::Prove(read, Purpose::Read)
            }
            _ if diagnostic => self.by_diagnostic(now),
            _ => self.wait(id, care, now),
        }
    }

    /// Waits until outstanding requests of `id` can no longer be answered.
    fn wait(&mut self, id: u8, care: &Care, now: Instant) -> Step {
        let Some(unit) = self.entry(id) else { return Step::Direct };
        if !unit.waited {
            unit.waited = true;
            unit.held_until = now + care.late_window;
        }
        if unit.held_until > now {
            return Step::Wait;
        }
        unit.waited = false;
        unit.unproven = true;
        unit.responds_to_diagnostics = false;
        unit.ignored = match unit.ignored {
            IGNORED_RETRY.. => IGNORED_MAX - 1,
            ignored => ignored + 1,
        };
        let port = self.port as u8;
        self.all.outstanding.settle_all(port, id);
        Step::Direct
    }

    /// Records that `request` is being sent to `id`.
    pub fn sent(&mut self, id: u8, request: &[u8], purpose: Purpose) {
        if self.list().frozen {
            return;
        }
        let port = self.port as u8;
        self.all.outstanding.sent(port, id, Shape::of_request(request), purpose);
        if let Some(unit) = self.entry(id) {
            if purpose == Purpose::Request {
                unit.asked();
            }
            (unit.open, unit.responded, unit.waited) = (true, false, false);
        }
    }

    /// Records that a truncated request was sent to `id`, which may have accepted it: its response is unknown.
    pub fn sent_in_part(&mut self, id: u8) {
        self.all.outstanding.forget(self.port as u8, id);
    }

    /// Matches a valid `response` from `id`. `Ok` if it is the expected one (`expected`: one is expected from `id`), otherwise the
    /// event to count.
    pub fn match_response(
        &mut self,
        id: u8,
        response: &[u8],
        expected: bool,
        now: Instant,
    ) -> Result<(), Event> {
        if self.list().frozen {
            return if expected { Ok(()) } else { Err(Event::Unsolicited) };
        }
        let port = self.port as u8;
        let Settled { whose, passed_diagnostic, is_diagnostic } =
            self.all.outstanding.match_response(port, id, response);
        let late = match whose {
            Match::Latest(_) if expected => None,
            Match::Latest(purpose) | Match::Earlier(purpose) => Some(purpose),
            Match::Several => Some(Purpose::Unsolicited),
            Match::Unsolicited => None,
        };
        let in_step = self.is_in_step(id, false);
        if let Some(unit) = self.known(id) {
            unit.responded = true;
            if in_step && unit.waited {
                // No response is outstanding any more.
                (unit.waited, unit.held_until) = (false, now);
            }
            unit.responds_to_diagnostics |= is_diagnostic;
            unit.ignored = match is_diagnostic {
                true => 0,
                false => unit.ignored.saturating_add(u8::from(passed_diagnostic)),
            };
            if passed_diagnostic {
                // It is responding, only late or to something else: no reason to back off further.
                unit.tried = 0;
            }
            if let Some(purpose) = late {
                unit.was_late(purpose, in_step, now);
            }
        }
        match (late, whose) {
            (Some(_), _) => {
                // It may be held now.
                self.set_needs_check(true);
                Err(Event::Late)
            }
            (None, Match::Unsolicited) => Err(Event::Unsolicited),
            (None, _) => Ok(()),
        }
    }

    /// Records that `id` has answered the proof.
    pub fn proved(&mut self, id: u8) {
        if let Some(unit) = self.entry(id) {
            unit.alive();
            (unit.open, unit.by_read, unit.unproven, unit.hurried) = (false, false, false, false);
        }
    }

    /// Records that `id` has not answered a proof. Returns whether the request waiting for it fails too: not if something else was
    /// received. The proof does not count towards being down, but delays the next one.
    pub fn not_proved(&mut self, id: u8, now: Instant, down_after: u8) -> bool {
        self.set_needs_check(true);
        let Some(unit) = self.entry(id) else { return true };
        (unit.open, unit.by_read) = (false, !unit.by_read);
        if unit.responded {
            return false;
        }
        unit.silent = unit.silent.saturating_add(1);
        unit.is_down |= down_after != 0 && unit.silent >= down_after;
        if down_after != 0 {
            unit.back_off(now);
        }
        true
    }

    /// Whether `id` has come back (true) or gone down since this was asked last.
    pub(crate) fn turned(&mut self, id: u8) -> Option<bool> {
        let unit = self.known(id).filter(|unit| unit.told_down != unit.is_down)?;
        unit.told_down = unit.is_down;
        Some(!unit.is_down)
    }

    /// Learns from a response of `id` to `request`.
    pub fn learn(&mut self, id: u8, request: &[u8]) {
        if let (Some(read), Some(unit)) = (as_read(request), self.known(id)) {
            unit.remember(read);
        }
    }

    /// The entry of `id`, if it exists.
    fn known(&mut self, id: u8) -> Option<&mut Unit> {
        let slots = self.list().slots();
        self.all.units.get_mut(slots)?.iter_mut().find(|unit| unit.id == id)
    }
}

/// `request` as a read of functions 1 to 4.
fn as_read(request: &[u8]) -> Option<Read> {
    match request {
        [READ_COILS..=READ_INPUT_REGISTERS, ..] => request.try_into().ok(),
        _ => None,
    }
}

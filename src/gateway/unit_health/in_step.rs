//! Whether a unit is in step, and what proves it: the rules of [`outstanding`](crate::gateway::outstanding), applied to what is
//! known of each unit.

use super::*;

impl Units<'_> {
    /// Whether no earlier request of `id` can still be answered; `open`: but the one whose response is awaited.
    pub fn is_in_step(&self, id: u8, open: bool) -> bool {
        self.list().frozen || self.all.outstanding.is_in_step(self.port as u8, id, open)
    }

    /// How `unit` is doing.
    pub fn state(&self, unit: &Unit, now: Instant) -> State {
        match unit {
            _ if unit.is_down => State::Down,
            _ if unit.held_until > now => State::Held,
            _ if !self.is_in_step(unit.id, unit.open) => State::OutOfStep,
            _ => State::Up,
        }
    }

    /// What may be sent to `id`, where `request` is to be sent.
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

    /// Function 8, until the unit is known to ignore that; in turn with a read, which proves something if no response to what
    /// was sent before looks like its own, and else tells at least whether function 8 is ignored.
    fn find_proof(&mut self, id: u8, request: &[u8], care: &Care, now: Instant) -> Step {
        let Some(&Unit { reads: [first, second], ignored, by_read, tried, answers_diagnostics, .. }) =
            self.find(id)
        else {
            return self.by_diagnostic(now);
        };
        let shape = Shape::of_request(request);
        let asked = as_read(request).unwrap_or(NO_READ);
        // Any that is known, or is asked for anyway; one that settles what was sent before it was sent for the first time; one whose
        // response fits nothing that was sent before.
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
        let answers_nothing = telling.is_none() && tried >= TRIED_MAX;
        let most = if answers_diagnostics { IGNORED_RETRY } else { IGNORED_MAX };
        let diagnostic = ignored < most && !answers_nothing;
        let other = if diagnostic { settling.or(telling) } else { settling };
        match proving.or(other.filter(|_| !answers_diagnostics)) {
            Some(read) if by_read && !answers_diagnostics || !diagnostic => Step::Prove(read, Purpose::Read),
            _ if diagnostic => self.by_diagnostic(now),
            _ => self.wait(id, care, now),
        }
    }

    /// Waits until what is outstanding at `id` is not to be expected any more.
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
        unit.answers_diagnostics = false;
        unit.ignored = match unit.ignored {
            IGNORED_RETRY.. => IGNORED_MAX - 1,
            ignored => ignored + 1,
        };
        let port = self.port as u8;
        self.all.outstanding.settle_all(port, id);
        Step::Direct
    }

    /// `request` is sent to `id` now.
    pub fn sent(&mut self, id: u8, request: &[u8], purpose: Purpose) {
        if self.list().frozen {
            return;
        }
        let port = self.port as u8;
        self.all.outstanding.sent(port, id, Shape::of_request(request), purpose);
        if let Some(unit) = self.entry(id) {
            (unit.open, unit.responded, unit.waited) = (true, false, false);
        }
    }

    /// A part of a request was sent to `id` that may have been taken for a whole one: what it answers is not known.
    pub fn sent_in_part(&mut self, id: u8) {
        self.all.outstanding.forget(self.port as u8, id);
    }

    /// `id` has sent `response`, whole and undamaged. Says whether it is the one that is awaited, if that is `awaited` of `id`; or
    /// else what is to be counted.
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
                // Nothing is left to be waited for.
                (unit.waited, unit.held_until) = (false, now);
            }
            unit.answers_diagnostics |= is_diagnostic;
            unit.ignored = match is_diagnostic {
                true => 0,
                false => unit.ignored.saturating_add(u8::from(passed_diagnostic)),
            };
            if passed_diagnostic {
                // It answers, only not that: no reason to wait for longer and longer.
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

    /// `id` has answered the proof that was sent.
    pub fn proved(&mut self, id: u8) {
        if let Some(unit) = self.entry(id) {
            unit.alive();
            (unit.open, unit.by_read, unit.unproven, unit.hurried) = (false, false, false, false);
        }
    }

    /// `id` has not answered a proof. Says whether that leaves the request without a response that waited for it: not if something
    /// else was heard. The proof itself does not count towards being down, but the next one waits.
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

    /// `id` has answered `request`.
    pub fn learn(&mut self, id: u8, request: &[u8]) {
        if let (Some(read), Some(unit)) = (as_read(request), self.known(id)) {
            unit.remember(read);
        }
    }

    /// The unit `id` if it is known.
    fn known(&mut self, id: u8) -> Option<&mut Unit> {
        let slots = self.list().slots();
        self.all.units.get_mut(slots)?.iter_mut().find(|unit| unit.id == id)
    }
}

/// The read by functions 1 to 4 that `request` is.
fn as_read(request: &[u8]) -> Option<Read> {
    match request {
        [READ_COILS..=READ_INPUT_REGISTERS, ..] => request.try_into().ok(),
        _ => None,
    }
}

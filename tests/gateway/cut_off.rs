//! Whoever makes a change that cuts him off is told so, and nobody else is: held against trying to come in again afterwards.

use std::fmt::Write as _;

use mobgate::console::{Mode, run};
use mobgate::gateway::Gateway;
use mobgate::hal::{NoUpdate, Store, System};
use mobgate::settings::PasswordHash;
use mobgate_simulator::console::{Medium, Terminal};
use mobgate_simulator::random::each_seed;

use crate::prelude::*;

/// The hashes of passwords; those are `one` and `two`.
const HASHES: [(&str, &str); 2] = [
    ("one", "$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$MbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA"),
    ("two", "$argon2id$v=19$m=8,t=1,p=1$MDEyMzQ1Njc4OWFiY2RlZg$NbnuQj2xrGASZb+GaVRPOkBaCDUjNErQQKePN3mCUfA"),
];

/// A system with these passwords.
pub(crate) struct Board;

impl System for Board {
    fn name(&self) -> &str {
        "board"
    }

    async fn is_password(&self, hash: Option<&str>, password: &str) -> bool {
        HASHES.iter().any(|(typed, known)| *typed == password && hash == Some(*known))
    }

    /// Nobody guesses here: it only has to be another one at another time.
    fn random(&self, into: &mut [u8]) -> bool {
        into.fill(Instant::now().as_millis() as u8);
        true
    }

    async fn hash_password(&self, _: &str) -> Option<PasswordHash> {
        None
    }

    fn reboot(&self) {}
}

/// The line of the user who comes by network.
pub(crate) fn user() -> String {
    format!("user anna role engineer password \"{}\"", HASHES[0].1)
}

/// What a session of that user, who has come by the port `access`, prints after `text`.
pub(crate) async fn by_network(gateway: &Gateway<'_>, store: &mut impl Store, text: &str) -> String {
    let port = gateway.settings(|settings| settings.find("access"));
    let text = format!("anna\none\n{text}\n");
    let (mut terminal, mut no_update) = (Terminal::of(&text), NoUpdate("this is a simulation"));
    let mode = Mode::Network(machine(1), port);
    let Ok(_) = run(gateway, &mut terminal, store, &mut no_update, &Board, mode).await;
    terminal.printed()
}

/// Changes, most of which cut off someone.
fn line(random: &mut Random) -> String {
    let port = [502, 502, 503][random.index(3)];
    let name = ["access", "other"][random.index(2)];
    let words = [
        "",
        "",
        " rtu",
        " clients 2",
        " allow 10.0.0.0/8",
        " allow 10.0.0.1",
        " allow 10.0.0.2,10.0.0.1",
        " allow 10.0.0.2",
        " idle 30s",
    ][random.index(9)];
    let (user, role) =
        (["anna", "bert"][random.index(2)], ["engineer", "engineer", "viewer"][random.index(3)]);
    match random.index(8) {
        0..=2 => format!("port {name} tcp server {port}{words}"),
        3 => format!("delete port {name}"),
        4 => format!("delete user {user}"),
        5 => format!("user {user} role {role}"),
        6 => format!("user {user} role {role} password \"{}\"", HASHES[random.index(2)].1),
        _ => format!("edit port access{words}"),
    }
}

/// Whether that user comes in from his machine to where he came in before, logs in, and may change settings.
fn comes_in(world: &mut World<'_>, rig: &Rig<'_>) -> bool {
    let Ok(stream) = rig.network.connect(machine(1), 502) else { return false };
    let mut client = Client::new(stream);
    let said = world.run_until(client.request(1, &READ));
    if !matches!(said, Response::Pdu(_)) {
        return false;
    }
    let said = world.run_until(by_network(rig.gateway, &mut Medium::default(), "commit check"));
    said.contains("there is no candidate") || said.contains("the board can have it")
}

#[test]
fn a_change_is_refused_exactly_if_who_makes_it_could_not_come_in_again() {
    let (mut refused, mut done) = (0, 0);
    each_seed(400, |seed| {
        let mut random = Random::new(seed);
        let settings = format!("{}\nport access tcp server 502\n", user());
        with_gateway(seed, &settings, |world, rig| {
            assert!(comes_in(world, rig), "seed {seed}");
            let mut text = String::new();
            let mut store = Medium::default();
            let is_direct = random.chance(0.5);
            if is_direct {
                let _ = write!(text, "{}", line(&mut random));
            } else {
                let lines: String = (0..=random.index(3)).map(|_| line(&mut random) + "\n").collect();
                let _ = write!(text, "candidate\n{lines}commit");
            }
            let said = world.run_until(by_network(rig.gateway, &mut store, &text));
            let is_refused = said.contains("this would cut you off");
            if is_refused {
                // He does it nevertheless, in a way that goes back.
                assert!(comes_in(world, rig), "seed {seed}: {text}: {said}");
                let again = if is_direct { format!("candidate\n{text}\n") } else { String::new() };
                let confirmed = again + "commit confirmed 1m";
                let said = world.run_until(by_network(rig.gateway, &mut store, &confirmed));
                assert!(said.contains("in force: commit within"), "seed {seed}: {text}: {said}");
            }
            world.run_for(SECOND);
            assert_eq!(comes_in(world, rig), !is_refused, "seed {seed}: {text}: {said}");
            if is_refused {
                world.spawn(rig.gateway.watch_commits());
                world.run_for(60 * SECOND);
                assert!(comes_in(world, rig), "seed {seed}: {text}: the settings from before are back");
            }
            if is_refused { refused += 1 } else { done += 1 }
        });
    });
    println!("{refused} changes refused, {done} done");
}

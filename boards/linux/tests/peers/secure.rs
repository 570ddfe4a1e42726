//! Modbus/TCP Security with clients by others: OpenSSL's `s_client`, pymodbus and pysunspec2, who show certificates of all sorts.

use std::io::Write;
use std::net::{Shutdown, TcpStream};
use std::process::{Command, Stdio};
use std::sync::Arc;

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};

use crate::authority::{Authority, Unusual};
use crate::common::{PATIENCE, Program, ask, wait_for, with_console};
use crate::outside::{Tool, script};
use crate::secure_device::Device;

/// Reads registers 2 and 3 of unit 1, with the transaction id 7.
const READ: [u8; 12] = [0, 7, 0, 0, 0, 6, 1, 3, 0, 2, 0, 2];
/// Writes 5 to register 4.
const WRITE: [u8; 12] = [0, 8, 0, 0, 0, 6, 1, 6, 0, 4, 0, 5];
/// Writes 5 to register 100.
const WRITE_FAR: [u8; 12] = [0, 9, 0, 0, 0, 6, 1, 6, 0, 100, 0, 5];
/// The response to [`READ`], and 01 instead.
const VALUES: [u8; 13] = [0, 7, 0, 0, 0, 7, 1, 3, 4, 0, 2, 0, 3];
const REFUSED_READ: [u8; 9] = [0, 7, 0, 0, 0, 3, 1, 0x83, 1];
const REFUSED_WRITE: [u8; 9] = [0, 8, 0, 0, 0, 3, 1, 0x86, 1];

/// A gateway with a secure port before a device, and certificates of clients.
struct Plant {
    program: Program,
    authority: Authority,
    device: Device,
}

impl Plant {
    /// Viewers read, operators also write registers 0 to 9, engineers everything of unit 1. Unit 2 is for whoever has a certificate.
    fn start() -> Self {
        let (authority, device) = (Authority::new("plant"), Device::start());
        authority.certify("gateway", Unusual::default());
        for role in ["viewer", "operator", "engineer", "visitor"] {
            authority.certify(role, Unusual { roles: &[role], ..Unusual::default() });
        }
        let folder = authority.folder().display();
        let program = with_console(&format!(
            "certificate gateway own {folder}/gateway.pem key {folder}/gateway.key
             certificate plant clients {folder}/plant.pem revoked {folder}/plant.crl
             port secure tcp server 127.0.0.1:{{port}} tls
             port device tcp client 127.0.0.1:{} timeout 30s
             route secure 1 * * device role viewer readonly
             route secure 1 * * device role operator writes 0-9
             route secure 1 * * device role engineer
             route secure 2 * =1 device
",
            device.port
        ));
        Self { program, authority, device }
    }

    /// `openssl s_client` with the certificate of `who`, or without.
    fn openssl(&self, who: Option<&Authority>, name: &str, options: &[&str]) -> Command {
        let mut command = Command::new("openssl");
        let at = format!("127.0.0.1:{}", self.program.port);
        command.args(["s_client", "-connect", &at, "-verify_return_error", "-CAfile"]);
        command.arg(self.authority.file("plant.pem")).args(options);
        if let Some(authority) = who {
            command.arg("-cert").arg(authority.file(&format!("{name}.pem")));
            command.arg("-key").arg(authority.file(&format!("{name}.key")));
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// What comes back for `requests` by OpenSSL: bytes of Modbus, and what it says.
    fn exchange(&self, mut command: Command, requests: &[u8], bytes: usize) -> (Vec<u8>, String) {
        let mut client = command.arg("-quiet").spawn().expect("apt-get install openssl");
        let mut input = client.stdin.take().unwrap();
        // A client that was refused may be gone.
        let _ = input.write_all(requests).and_then(|()| input.flush());
        let mut output = client.stdout.take().unwrap();
        let mut got = Vec::new();
        let mut piece = [0; 256];
        while got.len() < bytes {
            match std::io::Read::read(&mut output, &mut piece).unwrap() {
                0 => break,
                count => got.extend(&piece[..count]),
            }
        }
        drop(input);
        let _ = client.kill();
        let said = client.wait_with_output().unwrap();
        (got, String::from_utf8_lossy(&said.stderr).into_owned())
    }

    /// The same of the client called `name` of the plant's authority.
    fn ask(&self, name: &str, requests: &[u8], bytes: usize) -> Vec<u8> {
        self.exchange(self.openssl(Some(&self.authority), name, &[]), requests, bytes).0
    }

    /// Asserts that a client gets nothing, and why.
    fn refuses(&self, command: Command, why: &str) {
        let (got, said) = self.exchange(command, &READ, VALUES.len());
        assert!(got.is_empty(), "{got:?}: {said}");
        self.program.logs(why);
    }

    /// Asserts that nothing of what happened before keeps a good client out.
    fn serves_others(&self) {
        assert_eq!(self.ask("viewer", &READ, VALUES.len()), VALUES);
    }
}

#[test]
fn each_role_may_do_what_its_rules_say_and_no_other() {
    let plant = Plant::start();
    let all = [&READ[..], &WRITE, &WRITE_FAR].concat();
    let mut refused_far = WRITE_FAR[..9].to_vec();
    (refused_far[5], refused_far[7], refused_far[8]) = (3, 0x86, 2);
    // Responses may come in any order: one request at a time.
    for (role, read, write, far) in [
        ("viewer", &VALUES[..], &REFUSED_WRITE[..], &[0, 9, 0, 0, 0, 3, 1, 0x86, 1][..]),
        ("operator", &VALUES[..], &WRITE[..], &refused_far[..]),
        ("engineer", &VALUES[..], &WRITE[..], &WRITE_FAR[..]),
        ("visitor", &REFUSED_READ[..], &REFUSED_WRITE[..], &[0, 9, 0, 0, 0, 3, 1, 0x86, 1][..]),
    ] {
        for (nth, response) in [read, write, far].into_iter().enumerate() {
            let request = &all[12 * nth..12 * nth + 12];
            assert_eq!(plant.ask(role, request, response.len()), response, "{role}");
        }
    }
    assert_eq!(plant.device.written(), [(4, 5), (4, 5), (100, 5)]);
    plant.program.logs("127.0.0.1: a write to unit 1 by function 6 is denied at port secure");
    // The refusal leaves the session as it was, and a rule without a role is for all.
    let mut unit_2 = READ;
    unit_2[6] = 2;
    let both = plant.ask("visitor", &[READ, unit_2].concat(), REFUSED_READ.len() + VALUES.len());
    assert_eq!(both[..9], REFUSED_READ);
    assert_eq!((both[15], &both[16..]), (2, &VALUES[7..]));
}

#[test]
fn a_client_without_a_certificate_or_with_one_that_is_not_good_is_refused() {
    let plant = Plant::start();
    let foreign = Authority::new("foreign");
    foreign.certify("engineer", Unusual { roles: &["engineer"], ..Unusual::default() });
    plant.authority.certify("old", Unusual { roles: &["engineer"], days: Some(-1), ..Unusual::default() });
    for version in ["-tls1_2", "-tls1_3"] {
        let by = |who, name| plant.openssl(who, name, &[version]);
        plant.refuses(by(None, ""), "a client is refused, it shows no certificate,");
        plant.refuses(by(Some(&foreign), "engineer"), "its certificate is of no trusted authority,");
        plant.refuses(by(Some(&plant.authority), "old"), "its certificate has expired,");
    }
    plant.serves_others();
    assert!(plant.device.written().is_empty());
}

#[test]
fn a_revoked_certificate_is_refused_from_the_next_connection_on() {
    let plant = Plant::start();
    let serial = plant.authority.certify("lost", Unusual { roles: &["engineer"], ..Unusual::default() });
    assert_eq!(plant.ask("lost", &WRITE, WRITE.len()), WRITE);
    plant.authority.revoke(&[serial]);
    plant.refuses(plant.openssl(Some(&plant.authority), "lost", &[]), "its certificate is revoked,");
    plant.serves_others();
}

#[test]
fn no_role_two_roles_and_a_role_that_is_none_are_the_null_role() {
    let plant = Plant::start();
    let long = "engineer-of-the-whole-plant-and-more";
    for (name, roles) in
        [("none", &[][..]), ("two", &["engineer", "viewer"]), ("empty", &[""]), ("long", &[long])]
    {
        plant.authority.certify(name, Unusual { roles, ..Unusual::default() });
        assert_eq!(plant.ask(name, &READ, REFUSED_READ.len()), REFUSED_READ, "{name}");
    }
}

#[test]
fn tls_1_2_and_1_3_are_spoken_and_nothing_older() {
    let plant = Plant::start();
    for version in ["-tls1_2", "-tls1_3"] {
        let command = plant.openssl(Some(&plant.authority), "viewer", &[version]);
        assert_eq!(plant.exchange(command, &READ, VALUES.len()).0, VALUES, "{version}");
    }
    for version in ["-tls1", "-tls1_1"] {
        let options = [version, "-cipher", "DEFAULT@SECLEVEL=0"];
        let command = plant.openssl(Some(&plant.authority), "viewer", &options);
        let (got, said) = plant.exchange(command, &READ, VALUES.len());
        assert!(got.is_empty() && said.contains("alert"), "{version}: {said}");
    }
    plant.program.logs("it knows neither TLS 1.2 nor 1.3 as the gateway does,");
    // Whoever does not speak TLS at all.
    let mut plain = plant.program.connect();
    plain.write_all(&READ).unwrap();
    let mut got = Vec::new();
    let _ = std::io::Read::read_to_end(&mut plain, &mut got);
    assert!(!got.starts_with(&READ[..2]), "{got:?}");
    plant.program.logs("it does not speak TLS,");
    plant.serves_others();
}

#[test]
fn a_renegotiation_is_refused() {
    let plant = Plant::start();
    let mut command = plant.openssl(Some(&plant.authority), "viewer", &["-tls1_2"]);
    let mut client = command.spawn().unwrap();
    // Its command for a renegotiation.
    client.stdin.as_mut().unwrap().write_all(b"R\n").unwrap();
    let ended = client.wait_with_output().unwrap();
    let said = [ended.stdout, ended.stderr].concat();
    let said = String::from_utf8_lossy(&said);
    assert!(said.contains("RENEGOTIATING") && said.contains("no renegotiation"), "{said}");
    assert!(!ended.status.success());
    plant.serves_others();
}

/// A connection of our own with the certificate of `name`, whose ends can be cut.
fn connect(plant: &Plant, name: &str) -> StreamOwned<ClientConnection, TcpStream> {
    let file = |ending: &str| plant.authority.file(&format!("{name}.{ending}"));
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(plant.authority.file("plant.pem")).unwrap()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions().unwrap();
    let config = config.with_root_certificates(roots).with_client_auth_cert(
        vec![CertificateDer::from_pem_file(file("pem")).unwrap()],
        PrivateKeyDer::from_pem_file(file("key")).unwrap(),
    );
    let name = ServerName::try_from("127.0.0.1").unwrap();
    let connection = ClientConnection::new(Arc::new(config.unwrap()), name).unwrap();
    StreamOwned::new(connection, plant.program.connect())
}

#[test]
fn what_is_cut_off_is_not_carried_out() {
    let plant = Plant::start();
    // Half a request in a whole record, and no close_notify behind it.
    let mut half = connect(&plant, "engineer");
    half.write_all(&WRITE[..9]).unwrap();
    half.flush().unwrap();
    half.sock.shutdown(Shutdown::Both).unwrap();
    // Half a record.
    let mut cut = connect(&plant, "engineer");
    cut.conn.complete_io(&mut cut.sock).unwrap();
    cut.conn.writer().write_all(&WRITE).unwrap();
    let mut record = Vec::new();
    cut.conn.write_tls(&mut record).unwrap();
    cut.sock.write_all(&record[..record.len() - 4]).unwrap();
    cut.sock.shutdown(Shutdown::Write).unwrap();
    // A record of which one bit is another.
    let mut flipped = connect(&plant, "engineer");
    flipped.conn.complete_io(&mut flipped.sock).unwrap();
    flipped.conn.writer().write_all(&WRITE).unwrap();
    let mut record = Vec::new();
    flipped.conn.write_tls(&mut record).unwrap();
    *record.last_mut().unwrap() ^= 1;
    flipped.sock.write_all(&record).unwrap();
    // Each of them is gone, and what comes later is served.
    let mut session = plant.program.session();
    let mut is_there = |role: &str| {
        let said = crate::common::converse(&mut session, "show clients\nshow version\n", "mobgate 0.");
        said.contains(&format!("role {role}"))
    };
    wait_for("the end of the connections", || (!is_there("engineer")).then_some(()));
    let mut viewer = connect(&plant, "viewer");
    viewer.write_all(&READ).unwrap();
    std::io::Read::read_exact(&mut viewer, &mut [0; VALUES.len()]).unwrap();
    assert!(is_there("viewer"), "show clients has the roles");
    plant.serves_others();
    assert!(plant.device.written().is_empty());
}

#[test]
fn pymodbus_and_pysunspec2_are_served_by_their_roles() {
    let plant = Plant::start();
    let by = |peer: &str, name: &str| {
        let file = |name: &str| plant.authority.file(name).to_str().unwrap().to_owned();
        let files = [file("plant.pem"), file(&format!("{name}.pem")), file(&format!("{name}.key"))];
        let (script, port) = (script("secure_client.py"), plant.program.port.to_string());
        let [ca, certificate, key] = &files;
        let arguments = [script.to_str().unwrap(), peer, &port, ca, certificate, key];
        let (good, said) = Tool::python().run(&arguments);
        assert!(good, "{peer} as {name}: {said}");
        said
    };
    for (peer, read) in [("pymodbus", "read [2, 3]"), ("pysunspec2", "maker Peerworks")] {
        let said = by(peer, "engineer");
        assert!(said.contains(read) && said.contains("write done"), "{peer}: {said}");
        let said = by(peer, "viewer");
        assert!(said.contains(read) && !said.contains("write done"), "{peer}: {said}");
    }
    let said = by("pymodbus", "visitor");
    assert!(said.contains("read 1\n") && said.contains("write 1\n"), "{said}");
}

#[test]
fn the_console_shows_the_certificates_and_the_log_has_those_that_end_soon() {
    let authority = Authority::new("plant");
    authority.certify("gateway", Unusual { days: Some(29), ..Unusual::default() });
    let folder = authority.folder().display();
    let settings = format!(
        "certificate gateway own {folder}/gateway.pem key {folder}/gateway.key
certificate plant clients {folder}/plant.pem
certificate gone servers {folder}/gone.pem
port secure tcp server 127.0.0.1:{{port}} tls
"
    );
    let program = with_console(&settings);
    program.logs("certificate gateway: expires in 28 days");
    program.logs("gone.pem: no such file");
    let mut session = program.session();
    let said = crate::common::converse(&mut session, "show certificates\nshow version\n", "mobgate 0.");
    let row = |name: &str| said.lines().find(|line| line.starts_with(name)).unwrap_or_default();
    assert!(row("gateway").contains("CN=gateway") && row("gateway").contains("expires in 28 days"), "{said}");
    assert!(row("gateway").contains("CN=plant"), "the issuer: {said}");
    assert!(row("plant").ends_with("good"), "{said}");
    assert!(row("gone").contains("no such file"), "{said}");
    // Renewed: it counts at once, without a restart.
    authority.certify("gateway", Unusual::default());
    let said = crate::common::converse(&mut session, "show certificates\nshow version\n", "mobgate 0.");
    assert!(!said.contains("expires in"), "{said}");
}

#[test]
fn private_keys_are_shown_nowhere_and_one_that_everybody_may_read_is_not_used() {
    use std::os::unix::fs::PermissionsExt;
    let plant = Plant::start();
    let key = std::fs::read_to_string(plant.authority.file("gateway.key")).unwrap();
    let secret: Vec<&str> = key.lines().filter(|line| !line.starts_with('-')).collect();
    let mut session = plant.program.session();
    let lines = "show config secrets\nshow config\nshow certificates\nshow audit\nshow version\n";
    let said = crate::common::converse(&mut session, lines, "mobgate 0.") + &plant.program.log();
    assert!(said.contains("gateway.key") && !secret.iter().any(|line| said.contains(line)), "{said}");
    let file = plant.authority.file("gateway.key");
    std::fs::set_permissions(file, std::fs::Permissions::from_mode(0o644)).unwrap();
    let said = crate::common::converse(&mut session, "show certificates\nshow version\n", "mobgate 0.");
    assert!(said.contains("everybody may read it"), "{said}");
}

/// The gateway's own client between two gateways: a plain port of the first leads by TLS to the second, which has the device.
fn through(plant: &Plant, lines: &str) -> Program {
    Program::configured(
        &format!(
            "{lines}
         port P502 tcp server 127.0.0.1:{{port}}
         route P502 1 * * inverter
",
        )
        .replace("SECURE", &plant.program.port.to_string()),
    )
}

#[test]
fn the_gateway_is_a_client_with_a_certificate_and_checks_that_of_the_server() {
    let plant = Plant::start();
    let folder = plant.authority.folder().display();
    let own = format!("certificate me own {folder}/operator.pem key {folder}/operator.key\n");
    let by_authority =
        format!("{own}certificate plant servers {folder}/plant.pem revoked {folder}/plant.crl\n");
    let client = "port inverter tcp client 127.0.0.1:SECURE tls certificate me timeout 30s";
    let program = through(&plant, &format!("{by_authority}{client}"));
    assert_eq!(ask(&mut program.connect(), 1, &READ[7..]), VALUES[7..]);
    assert_eq!(ask(&mut program.connect(), 1, &WRITE[7..]), WRITE[7..]);
    // By its very certificate.
    let pinned = format!("{own}certificate gw servers {folder}/gateway.pem\n{client} trust gw");
    assert_eq!(ask(&mut through(&plant, &pinned).connect(), 1, &READ[7..]), VALUES[7..]);
    // Which is good only where the port names it.
    let unnamed = format!("{own}certificate gw servers {folder}/gateway.pem\n{client}");
    let program = through(&plant, &unnamed);
    assert_eq!(ask(&mut program.connect(), 1, &READ[7..]), [0x83, 0x0a]);
    program.logs("its certificate is of no trusted authority");
    // Without an own certificate the other gateway refuses it.
    let program = through(&plant, &format!("{by_authority}{}", client.replace(" certificate me", "")));
    let refused = ask(&mut program.connect(), 1, &READ[7..]);
    assert!(matches!(refused[..], [0x83, 0x0a | 0x0b]), "{refused:?}");
    plant.program.logs("it shows no certificate");
}

#[test]
fn servers_that_are_not_whom_they_should_be_get_no_request() {
    let plant = Plant::start();
    let foreign = Authority::new("foreign");
    let folder = plant.authority.folder().display();
    let refused = |lines: &str, why: &str| {
        let lines = format!("{lines}\nport inverter tcp client 127.0.0.1:SECURE tls timeout 30s");
        let program = through(&plant, &lines);
        assert_eq!(ask(&mut program.connect(), 1, &READ[7..]), [0x83, 0x0a], "{why}");
        program.logs(why);
    };
    let other = foreign.file("foreign.pem");
    refused(
        &format!("certificate x servers {}", other.display()),
        "its certificate is of no trusted authority",
    );
    let elsewhere = Some([10, 0, 0, 1].into());
    let by_plant = format!("certificate plant servers {folder}/plant.pem revoked {folder}/plant.crl");
    plant.authority.certify("gateway", Unusual { address: elsewhere, ..Unusual::default() });
    refused(&by_plant, "its certificate is for another address");
    plant.authority.certify("gateway", Unusual { days: Some(-1), ..Unusual::default() });
    refused(&by_plant, "its certificate has expired");
    let serial = plant.authority.certify("gateway", Unusual::default());
    plant.authority.revoke(&[serial]);
    refused(&by_plant, "its certificate is revoked");
    assert!(plant.device.written().is_empty());
}

#[test]
fn an_openssl_server_that_asks_for_no_certificate_is_used_without_one() {
    let authority = Authority::new("plant");
    authority.certify("inverter", Unusual::default());
    let port = crate::common::free_port();
    let mut server = Command::new("openssl");
    server.args(["s_server", "-quiet", "-accept", &format!("127.0.0.1:{port}")]);
    server.arg("-cert").arg(authority.file("inverter.pem")).arg("-key").arg(authority.file("inverter.key"));
    server.stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut server = crate::outside::Running(server.spawn().expect("apt-get install openssl"));
    wait_for("the server", || TcpStream::connect(("127.0.0.1", port)).ok());
    let program = Program::configured(&format!(
        "certificate plant servers {}
         port inverter tcp client 127.0.0.1:{port} tls timeout 30s
         port P502 tcp server 127.0.0.1:{{port}}
         route P502 1 * * inverter
",
        authority.file("plant.pem").display()
    ));
    let mut client = program.connect();
    client.set_read_timeout(Some(PATIENCE)).unwrap();
    client.write_all(&WRITE).unwrap();
    // What the server gets is what it prints, and what it sends is what is typed.
    let mut got = [0; WRITE.len()];
    std::io::Read::read_exact(server.0.stdout.as_mut().unwrap(), &mut got).unwrap();
    assert_eq!(got[2..], WRITE[2..], "but for the transaction id");
    let input = server.0.stdin.as_mut().unwrap();
    input.write_all(&got).and_then(|()| input.flush()).unwrap();
    let mut response = [0; WRITE.len()];
    std::io::Read::read_exact(&mut client, &mut response).unwrap();
    assert_eq!(response, WRITE);
}

//! The web interface by HTTPS, with a client by others: Python's, by OpenSSL.

use crate::authority::{Authority, Unusual};
use crate::common::{USER, converse, free_port, with_console};
use crate::outside::{Tool, script};

#[test]
fn a_client_by_https_checks_the_gateway_and_shows_its_own_certificate_where_the_port_trusts_it() {
    let (plant, port) = (Authority::new("plant"), free_port());
    plant.certify("gateway", Unusual::default());
    plant.certify("anna", Unusual::default());
    let (folder, number) = (plant.folder().display().to_string(), port.to_string());
    let program = with_console(&format!(
        "{USER}mdns off\ncertificate gateway own {folder}/gateway.pem key {folder}/gateway.key\n\
         certificate plant clients {folder}/plant.pem\nport web http server 127.0.0.1:{port} tls\n\
         port P502 tcp server 127.0.0.1:{{port}}\nroute P502 1 * * local\n"
    ));
    let call = |certificate: &str| {
        let script = script("https.py");
        Tool::python().run(&[script.to_str().unwrap(), &number, &folder, certificate])
    };
    let (good, said) = call("none");
    assert!(good, "{said}");
    assert!(said.contains("logged in: HttpOnly; SameSite=Strict; Path=/; Secure"), "{said}");
    // Of a page in cleartext, and without TLS at all.
    assert!(said.contains("other origin: 403") && said.contains("status: 200"), "{said}");
    assert!(said.contains("cleartext: no response"), "{said}");
    converse(&mut program.session(), "edit port web trust plant\nshow config\n", "trust plant");
    let (good, said) = call("none");
    assert!(!good && said.to_lowercase().contains("certificate required"), "{said}");
    program.logs("audit: 127.0.0.1: a client is refused, it shows no certificate, at port web");
    let (good, said) = call("anna");
    assert!(good && said.contains("status: 200"), "{said}");
}

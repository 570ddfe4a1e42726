//! Certificates, ports with TLS, and roles in rules: what is accepted, and what each error says.

use std::string::ToString;

use super::{apply_all, error_after, load, print, std};
use crate::language::apply;
use crate::settings::*;

const PLANT: &str = "certificate gateway own /tls/gw.pem key /tls/gw.key
certificate plant clients /tls/plant.pem revoked /tls/plant.crl
certificate vendor servers /tls/vendor.pem
port secure   tcp server 802 tls
port inverter tcp client 192.168.1.20:802 tls certificate gateway trust vendor
port P502     tcp server 502
port P1       serial uart1 rtu client 19200 8E1
route secure   1-9     * * P1 role operator writes 0-9
route secure   *       10.0.0.0/8 * inverter role engineer
route secure   7       * * P1 readonly
";

#[test]
fn certificates_secure_ports_and_roles_are_read_and_printed() {
    let settings = load(PLANT);
    assert_eq!(print(&settings), PLANT);
    let [gateway, plant, vendor] = settings.certificates() else { panic!("three") };
    assert_eq!((gateway.purpose, gateway.second.as_deref()), (Purpose::Own, Some("/tls/gw.key")));
    assert_eq!((plant.purpose, plant.second.as_deref()), (Purpose::Clients, Some("/tls/plant.crl")));
    assert_eq!((vendor.purpose, vendor.second.as_deref()), (Purpose::Servers, None));
    let tls = |name: &str| settings.port(settings.find(name).unwrap()).unwrap().kind.tls();
    assert_eq!((tls("secure").unwrap().certificate.as_deref(), tls("P502")), (None, None));
    assert_eq!(tls("inverter").unwrap().trust.as_deref(), Some("vendor"));
    assert_eq!(settings.routes[0].role.name(), "operator");
    assert!(settings.routes[2].role.is_none());
}

#[test]
fn a_line_replaces_the_certificate_of_its_name_and_edit_changes_what_it_names() {
    let mut settings = load(PLANT);
    apply_all(
        &mut settings,
        &[
            "certificate VENDOR servers /tls/other.pem revoked /tls/other.crl",
            "edit port inverter certificate none trust none",
            "edit port secure certificate gateway trust plant",
        ],
    );
    assert_eq!(settings.certificates().len(), 3);
    let text = print(&settings);
    assert!(text.contains("certificate VENDOR servers /tls/other.pem revoked /tls/other.crl\n"), "{text}");
    assert!(text.contains("tcp client 192.168.1.20:802 tls\n"), "{text}");
    assert!(text.contains("tcp server 802 tls certificate gateway trust plant\n"), "{text}");
    apply_all(&mut settings, &["edit port inverter no-tls", "delete certificate vendor"]);
    assert!(!print(&settings).contains("endor"));
}

#[test]
fn a_port_needs_its_certificates_and_keeps_them() {
    let mut empty = Settings::new();
    let lacks = |settings: &mut Settings, line: &str| apply(settings, line).unwrap_err().to_string();
    let said = lacks(&mut empty, "port secure tcp server 802 tls");
    assert_eq!(said, "column 6: \"secure\": there is no line certificate NAME own FILE key FILE");
    apply_all(&mut empty, &["certificate gw own /tls/gw.pem key /tls/gw.key"]);
    let said = lacks(&mut empty, "port secure tcp server 802 tls");
    assert!(said.ends_with("there is no line certificate NAME clients FILE"), "{said}");
    let said = lacks(&mut empty, "port inverter tcp client 10.0.0.1:802 tls");
    assert!(said.ends_with("there is no line certificate NAME servers FILE"), "{said}");
    let said = error_after(PLANT, "edit port inverter trust plant");
    assert!(said.ends_with("there is no line certificate plant servers FILE"), "{said}");
    for (line, port) in [
        ("delete certificate gateway", "secure"),
        ("delete certificate plant", "secure"),
        ("delete certificate vendor", "inverter"),
        ("certificate gateway clients /tls/gw.pem", "secure"),
    ] {
        let said = error_after(PLANT, line);
        assert!(
            said.ends_with(&std::format!("port {port} needs it: delete or edit the port first")),
            "{said}"
        );
    }
}

#[test]
fn wrong_lines_of_certificates_name_what_is_wrong() {
    for (line, expected) in [
        ("certificate 1 own /a key /b", "expected a certificate's name"),
        ("certificate x", "expected own, clients or servers"),
        ("certificate x clients tls/a.pem", "expected a file such as /etc/mobgate/tls/plant.pem"),
        ("certificate x own /a", "expected key and the file with the private key"),
        ("certificate x own /a key", "expected a file such as"),
        ("certificate x clients /a key /b", "expected revoked and the file with the list"),
        ("certificate x clients /a revoked /b /c", "expected the end of the line"),
        ("delete certificate nobody", "there is no certificate of this name"),
        ("port a tcp server 803 certificate gateway", "\"certificate\": needs tls"),
        ("port a tcp client 10.0.0.1 trust vendor", "\"trust\": needs tls"),
        ("port a tcp server 803 tls tls", "is set twice"),
        ("port a udp server 803 tls", "expected listen"),
        ("route P502 1 * * P1 role viewer", "\"role\": clients of this source have no role"),
        ("route secure 1 * * P1 role", "expected the role in clients' certificates"),
        ("route secure 1 * * P1 role a role b", "is set twice"),
        ("edit port secure no-tls", "rules 1, 2 name it with a role; clients have one with tls only"),
    ] {
        let said = error_after(PLANT, line);
        assert!(said.contains(expected), "{line}: {said}");
    }
    let mut settings = load(PLANT);
    for nth in settings.certificates().len()..CERTIFICATES_MAX {
        apply_all(&mut settings, &[&std::format!("certificate c{nth} servers /tls/c")]);
    }
    let full = apply(&mut settings, "certificate more servers /tls/c").unwrap_err().to_string();
    assert!(full.ends_with("there are 16 certificates already, the maximum"), "{full}");
}

#[test]
fn a_rule_for_one_role_hides_no_rule_for_another() {
    let mut settings = load(PLANT);
    let warning = |settings: &mut Settings, line: &str| apply(settings, line).unwrap().warning;
    assert_eq!(warning(&mut settings, "route secure 1-9 * * P1 role viewer readonly"), None);
    let hidden = warning(&mut settings, "route secure 2 * * P1 role operator").unwrap().to_string();
    assert_eq!(hidden, "rule 5 never matches: rule 1 takes all its requests");
}

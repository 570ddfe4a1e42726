//! Certificates of all sorts in a folder of their own, made by an authority of the test.

use std::fs;
use std::net::{IpAddr, Ipv4Addr};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use mobgate_linux::calendar;

use rcgen::{
    BasicConstraints, CertificateParams, CertificateRevocationListParams, CustomExtension, DnType,
    ExtendedKeyUsagePurpose, IsCa, Issuer, KeyIdMethod, KeyPair, KeyUsagePurpose, RevokedCertParams, SanType,
    SerialNumber,
};

/// Modbus/TCP Security 8.4.
const ROLE: [u64; 9] = [1, 3, 6, 1, 4, 1, 50316, 802, 1];
const UTF8_STRING: u8 = 0x0c;
const DAY: Duration = Duration::from_secs(86_400);

/// An authority, whose files are `NAME.pem`, `NAME.crl`, and for each certificate `OF.pem` and `OF.key`.
pub(crate) struct Authority {
    folder: tempfile::TempDir,
    issuer: Issuer<'static, KeyPair>,
    name: &'static str,
    serial: std::cell::Cell<u64>,
}

/// What is unusual about a certificate.
#[derive(Default)]
pub(crate) struct Unusual<'u> {
    pub(crate) roles: &'u [&'u str],
    /// Days from now; 365 by default.
    pub(crate) days: Option<i64>,
    /// Another address than 127.0.0.1.
    pub(crate) address: Option<Ipv4Addr>,
}

fn days_from_now(days: i64) -> SystemTime {
    let span = DAY * days.unsigned_abs() as u32;
    if days < 0 { calendar::now() - span } else { calendar::now() + span }
}

impl Authority {
    pub(crate) fn new(name: &'static str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut params = CertificateParams::new(Vec::new()).unwrap();
        params.distinguished_name.push(DnType::CommonName, name);
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        let key = KeyPair::generate().unwrap();
        fs::write(folder.path().join(format!("{name}.pem")), params.self_signed(&key).unwrap().pem())
            .unwrap();
        let authority =
            Self { folder, issuer: Issuer::new(params, key), name, serial: std::cell::Cell::new(1) };
        authority.revoke(&[]);
        authority
    }

    /// The path of one of the files.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Certifies `of`, for clients and servers at 127.0.0.1 for a year; gives the serial number.
    pub(crate) fn certify(&self, of: &str, Unusual { roles, days, address }: Unusual<'_>) -> u64 {
        let serial = self.serial.replace(self.serial.get() + 1);
        let mut params = CertificateParams::new(Vec::new()).unwrap();
        params.distinguished_name.push(DnType::CommonName, of);
        params.serial_number = Some(SerialNumber::from(serial));
        let address = address.unwrap_or(Ipv4Addr::LOCALHOST);
        params.subject_alt_names = vec![SanType::IpAddress(IpAddr::V4(address))];
        params.extended_key_usages =
            vec![ExtendedKeyUsagePurpose::ClientAuth, ExtendedKeyUsagePurpose::ServerAuth];
        let extension = |role: &&str| {
            let text = [&[UTF8_STRING, role.len() as u8], role.as_bytes()].concat();
            CustomExtension::from_oid_content(&ROLE, text)
        };
        params.custom_extensions = roles.iter().map(extension).collect();
        params.use_authority_key_identifier_extension = true;
        params.not_before = days_from_now(-100).into();
        params.not_after = days_from_now(days.unwrap_or(365)).into();
        let key = KeyPair::generate().unwrap();
        let certificate = params.signed_by(&key, &self.issuer).unwrap();
        fs::write(self.file(&format!("{of}.pem")), certificate.pem()).unwrap();
        let private = self.file(&format!("{of}.key"));
        fs::write(&private, key.serialize_pem()).unwrap();
        fs::set_permissions(private, fs::Permissions::from_mode(0o600)).unwrap();
        serial
    }

    /// Writes the list of revoked certificates, which are these.
    pub(crate) fn revoke(&self, serials: &[u64]) {
        let revoked = |serial: &u64| RevokedCertParams {
            serial_number: SerialNumber::from(*serial),
            revocation_time: days_from_now(-1).into(),
            reason_code: None,
            invalidity_date: None,
        };
        let list = CertificateRevocationListParams {
            this_update: days_from_now(-1).into(),
            next_update: days_from_now(30).into(),
            crl_number: SerialNumber::from(1),
            issuing_distribution_point: None,
            revoked_certs: serials.iter().map(revoked).collect(),
            key_identifier_method: KeyIdMethod::Sha256,
        };
        let list = list.signed_by(&self.issuer).unwrap();
        fs::write(self.file(&format!("{}.crl", self.name)), list.pem().unwrap()).unwrap();
    }
}

//! Start-up lists as configuration tools have them: the same SDOs, sent on each way to SafeOp.

use super::modules::{List, Objects, send};
use crate::prelude::*;

const SLAVES: u16 = 32;

fn word(index: u16, sub: u8, value: u16) -> (u16, u8, Vec<u8>) {
    (index, sub, value.to_le_bytes().to_vec())
}

/// 32 devices of all tables, within the 120 bytes of the PDOs that are assigned; the last SDO has them taken over.
fn start_up_list(random: &mut Random) -> List {
    let mut list = vec![word(0x2000, 1, SLAVES)];
    for nth in 0..SLAVES {
        let index = 0x2100 + nth;
        list.push(word(index, 1, 1 + random.index(247) as u16));
        // 1 byte of coils, 1 of discrete inputs, or a register: 64 bytes at most.
        let kind = random.index(4);
        let count = if kind < 2 { 1 + random.index(8) } else { 1 };
        for (at, sub) in [2, 4, 6, 8].into_iter().enumerate() {
            list.push(word(index, sub, if at == kind { count as u16 } else { 0 }));
            list.push(word(index, sub + 1, random.index(60_000) as u16));
        }
        list.push((index, 10, (1 + random.index(5_000) as u32).to_le_bytes().to_vec()));
        list.push((0x2007, nth as u8 + 1, vec![random.index(2) as u8]));
        list.push((0x2008, nth as u8 + 1, vec![random.index(3) as u8]));
        list.push(word(0x2009, nth as u8 + 1, random.index(65_536) as u16));
    }
    list.push((0x2020, 1, 19_200_u32.to_le_bytes().to_vec()));
    list.push(word(0x2020, 3, 2));
    list.push(word(0x2005, 1, 1));
    list
}

/// What is read back is what was sent, and it is in use.
fn check(rig: &mut Rig<Objects>, list: &List) {
    let (_, values) = list.split_last().unwrap();
    for (index, sub, value) in values {
        assert_eq!(rig.upload(*index, *sub).as_ref(), Ok(value), "{index:04x}:{sub:02x}");
    }
    assert_eq!(rig.upload(0x2005, 2), Ok(vec![1, 0]));
}

#[test]
fn statement_57_a_start_up_list_is_accepted_each_time_it_is_sent_and_the_configuration_stays_in_use() {
    let mut rig = gateway_in(PRE_OP);
    let list = start_up_list(&mut Random::new(1));
    send(&mut rig, &list);
    check(&mut rig, &list);
    let place = rig.application().shared();
    place.scanner().with(|scanner| scanner.image_mut(0, 1)[0] = 0xa5);
    for _ in 0..3 {
        send(&mut rig, &list);
        check(&mut rig, &list);
        assert!(place.is_running());
        place.inputs(|inputs| assert_eq!(inputs[0], 0xa5, "no device was begun anew"));
    }
}

#[test]
fn statement_57_another_list_opens_a_configuration_and_each_of_its_lengths_can_be_followed_by_the_whole() {
    let mut random = Random::new(2);
    let mut rig = gateway_in(PRE_OP);
    send(&mut rig, &start_up_list(&mut random));
    for _ in 0..20 {
        let other = start_up_list(&mut random);
        // It breaks off behind the first few SDOs that differ, or anywhere else.
        let cut = 3 + random.index(other.len() - 3);
        send(&mut rig, &other[..cut]);
        let in_use = if cut == other.len() { 1 } else { 0 };
        assert_eq!(rig.upload(0x2005, 2), Ok(vec![in_use, 0]), "cut at {cut}");
        send(&mut rig, &other);
        check(&mut rig, &other);
    }
}

#[test]
fn statement_57_in_safe_op_nothing_of_it_can_be_changed() {
    let mut rig = gateway_in(PRE_OP);
    let list = start_up_list(&mut Random::new(3));
    send(&mut rig, &list);
    rig.set_up_process_data();
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    assert_eq!(rig.download(0x2100, 1, &[9, 0]), Err(0x0800_0022));
    check(&mut rig, &list);
    rig.request(PRE_OP);
    rig.download(0x2100, 3, &[9, 0]).unwrap();
    assert_eq!(rig.upload(0x2005, 2), Ok(vec![0, 0]));
}

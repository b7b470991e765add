"""Payloads of UDP datagrams in a recording of a network (pcap)."""

import struct
from collections.abc import Iterator
from pathlib import Path

PCAP = (
    b"\xd4\xc3\xb2\xa1",
    b"\xa1\xb2\xc3\xd4",
    b"\x4d\x3c\xb2\xa1",
    b"\xa1\xb2\x3c\x4d",
)  # s and us, s and ns
PCAPNG = b"\x0a\x0d\x0d\x0a"
LINKS = {1: 14, 101: 0, 113: 16, 276: 20}  # Ethernet, plain IP, Linux' two: bytes before that of IP
VLAN, IPV4, UDP = b"\x81\x00", 4, 17


def payloads(path: Path | str, data: bytes) -> Iterator[bytes]:
    """What UDP datagrams over IPv4 carry; all other packets are left out.

    Parameters
    ----------
    path : Path or str
        The file, for messages.
    data : bytes
        What it holds.

    Yields
    ------
    bytes

    Raises
    ------
    ValueError
        For pcapng, and for a network of another kind.
    """
    if data.startswith(PCAPNG):
        raise ValueError(f"{path}: pcapng; make pcap of it: editcap -F pcap {Path(path).name} NAME.pcap")
    order = "<" if data[:4] in PCAP[::2] else ">"
    if len(data) < 24:
        raise ValueError(f"{path}: a recording of a network that ends within its header")
    link = struct.unpack_from(f"{order}I", data, 20)[0] & 0xFFFF
    if link not in LINKS:
        raise ValueError(f"{path}: packets of link type {link}; known are {', '.join(map(str, LINKS))}")
    at = 24
    while at + 16 <= len(data):
        kept = struct.unpack_from(f"{order}I", data, at + 8)[0]
        packet = data[at + 16 : at + 16 + kept]
        at += 16 + kept
        yield from _payload(packet, LINKS[link], link == 1)


def _payload(packet: bytes, head: int, ethernet: bool) -> Iterator[bytes]:
    while ethernet and packet[head - 2 : head] == VLAN:
        head += 4
    ip = packet[head:]
    if len(ip) < 28 or ip[0] >> 4 != IPV4 or ip[9] != UDP:
        return
    udp = ip[4 * (ip[0] & 15) :]
    if len(udp) >= 8:
        yield udp[8 : int.from_bytes(udp[4:6], "big")]

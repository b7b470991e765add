"""Sentences of AIS, data in ASTERIX and tables in Parquet become the same records as text does."""

import gzip
import struct
import sys
from datetime import UTC, date, datetime
from functools import reduce
from operator import xor

import numpy as np
import pytest

from gmr_gym.recorded import cut, read
from gmr_gym.recorded.formats import form_of
from gmr_gym.recorded.geodesy import to_local

SHIP = {"mmsi": 211000001, "speed": 12.3, "course": 90.0}
FERRY = {"mmsi": 211000002, "speed": 102.3, "course": 360.0}  # neither of them available
AT = 1_714_557_600  # 2024-05-01 10:00:00 UTC
DAY, TEN = date(2024, 5, 1), datetime(2024, 5, 1, 10, tzinfo=UTC)


def refused(message, *args, error=ValueError, **kwargs):
    with pytest.raises(error) as found:
        read(*args, **kwargs)
    assert message in str(found.value), str(found.value)
    assert "\n" not in str(found.value)


def written(path, lines):
    path.write_text("\n".join(lines))
    return path


# AIS


def sentences(kind, ship, lat=0.0, lon=0.0, **more):
    pyais = pytest.importorskip("pyais")
    message = {"type": kind, "lat": lat, "lon": lon, **ship, **more}
    return pyais.encode_dict(message, talker_id="AI", sentence_type="VDM")


def halves(sentence):
    """A message in two sentences."""
    *_, channel, payload, rest = sentence.split(",")
    bodies = f"AIVDM,2,1,3,{channel},{payload[:30]},0", f"AIVDM,2,2,3,{channel},{payload[30:]},{rest[0]}"
    return [f"!{body}*{reduce(xor, body.encode()):02X}" for body in bodies]


def tagged(sentence, time):
    from pyais import TagBlock

    return f"\\{TagBlock.create_str(source_station='shore', receiver_timestamp=time)}\\{sentence}"


def test_sentences_with_tag_blocks_are_reports_with_identities(tmp_path):
    """A message of two sentences has one time; a ship without a position and a damaged line are counted."""
    (ship,), (nowhere,) = sentences(1, SHIP, 54.0, 10.0), sentences(1, SHIP, 91, 181)
    first, second = halves(*sentences(19, FERRY, 54.01, 10.02, shipname="FERRY"))
    lines = [
        "# of a receiver", tagged(ship, AT), tagged(first, AT + 5), second, tagged(nowhere, AT + 6),
        tagged(ship.replace("*", "0*"), AT + 7), "$GPZDA,100007,01,05,2024,00,00*4A",
        tagged(sentences(24, SHIP, partno=0, shipname="SHIP")[0], AT + 8),
        tagged(sentences(18, SHIP, 54.002, 10.003)[0], AT + 10.5),
    ]  # fmt: skip
    file = written(tmp_path / "log.txt", lines)
    found = read(file)
    assert form_of(file) == "AIS" and found.identity.tolist() == ["211000001", "211000002", "211000001"]
    assert found.start == TEN and found.time.tolist() == [0, 5, 10.5] and found.row.tolist() == [2, 4, 9]
    places = [[54.0, 10.0, 0], [54.01, 10.02, 0], [54.002, 10.003, 0]]
    np.testing.assert_allclose(found.z, to_local(places, (54.0, 10.0, 0))[:, :2], atol=0.1)
    assert found.metadata["type"] == ["1", "19", "18"] and found.metadata["sog_kn"] == ["12.3", "", "12.3"]
    assert found.remarks[1:] == (
        "1 sentences with a wrong checksum dropped",
        "1 rows without a position dropped",
    )
    assert len(cut(found)) == 3  # each a report by itself
    assert read(file, where=["type!=19"]).row.tolist() == [2, 9]
    zipped = tmp_path / "log.gz"
    zipped.write_bytes(gzip.compress(file.read_bytes()))
    assert (read(zipped).z == found.z).all()


@pytest.mark.parametrize(
    "line, columns",
    [
        ("2024-05-01T10:00:{0:02d}Z {1}", None),
        ("[2024-05-01 10:00:{0:02d}]\t{1}", None),
        ("17145576{0:02d},{1}", {"time": "time:s"}),
        ("{1},rshore,17145576{0:02d}", {"time": "time:s"}),
        (r"\s:shore,c:17145576{0:02d}000*00\{1}", None),  # a tag block of milliseconds
    ],
)
def test_times_of_a_log_stand_beside_its_sentences(tmp_path, line, columns):
    (one,) = sentences(1, SHIP, 54.0, 10.0)
    found = read(written(tmp_path / "log.nmea", [line.format(second, one) for second in (0, 3)]), columns)
    assert found.start == TEN and found.time.tolist() == [0, 3]


def test_sentences_without_times_or_positions_are_refused_with_the_way_out(tmp_path, monkeypatch):
    (ship,) = sentences(1, SHIP, 54.0, 10.0)
    bare = written(tmp_path / "bare.txt", [ship])
    refused(r"only the second of the minute; have the receiver write tag blocks, as in \c:17", bare)
    number = written(tmp_path / "number.txt", [f"1714557600 {ship}"])
    refused("'1714557600' is a number; say of what by --time COLUMN:s", number)
    silent = written(tmp_path / "silent.txt", [tagged(sentences(24, SHIP, partno=0)[0], AT)])
    refused("silent.txt: AIS sentences, but no position reports with a time", silent)
    half = written(tmp_path / "half.txt", [tagged(ship, AT), ship])
    assert read(half).remarks[-1] == "1 reports without a time of reception dropped"
    monkeypatch.setitem(sys.modules, "pyais", None)
    refused("AIS needs the extra `ais`: pip install 'gmr-gym[ais]'", half, error=ImportError)


def test_a_table_with_a_column_of_sentences_is_a_table(tmp_path):
    file = written(tmp_path / "z.csv", ["time_s,x_m,y_m,raw", "0,1,2,!AIVDM", "1,2,3,!AIVDM"])
    assert form_of(file) == "text" and read(file).z.tolist() == [[1, 2], [2, 3]]


# ASTERIX


def block(category, *records):
    """A data block; sensor 100/19 unless a record says otherwise."""
    pytest.importorskip("asterix")
    from asterix import generated

    form = {34: generated.Cat_034_1_29, 48: generated.Cat_048_1_32}[category]
    sensor = {"010": (("SAC", 100), ("SIC", 19))}
    return form.create([form.cv_record.create(sensor | record) for record in records]).unparse().to_bytes()


def plot(time, away, azimuth, **more):
    polar = (("RHO", (away, "NM")), ("THETA", (azimuth, "°")))
    return {"140": (time, "s"), "040": polar, **more}


def north(time, **more):
    return block(34, {"000": 1, "030": (time, "s"), **more})


def pcap(*payloads):
    """Ethernet, IPv4, UDP; and a packet of another protocol."""
    data = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    for protocol, payload in [(6, b"TCP"), *((17, each) for each in payloads)]:
        udp = struct.pack(">HHHH", 8600, 8600, 8 + len(payload), 0) + payload
        ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 1, protocol, 0, b"", b"")
        frame = (bytes(12) + b"\x08\x00" + ip + udp).ljust(60, b"\0")
        data += struct.pack("<IIII", 0, 0, len(frame), len(frame)) + frame
    return data


def test_plots_of_asterix_are_cut_into_scans_at_north_markers(tmp_path):
    """Two feeds repeat rows, a plot may come after the marker that follows it, and midnight passes."""
    named = {"220": 0x3C660C, "090": (0, 0, ("FL", (330.0, "FL"))), "070": (0, 0, 0, 0, ("MODE3A", "7700"))}
    other = {"010": (("SAC", 100), ("SIC", 1))}
    blocks = [
        north(86396.0), block(48, plot(86397.0, 10, 45, **named), {"140": (86397.5, "s")}),
        block(48, plot(1, 10.5, 46)),
        north(1.0), block(48, plot(0.5, 10.3, 45.5)), block(48, plot(86397.0, 10, 45, **named)),
        block(48, plot(2.0, 10.5, 46, **other)), b"\x3e\x00\x03",
    ]  # fmt: skip
    (tmp_path / "raw.ast").write_bytes(b"".join(blocks))
    (tmp_path / "net.pcap").write_bytes(pcap(*blocks))
    (tmp_path / "busy.pcap").write_bytes(pcap(b"GET / HTTP/1.1", *blocks))
    assert "1 datagrams that are not ASTERIX left out" in read(tmp_path / "busy.pcap", day=DAY).remarks
    for name in ("raw.ast", "net.pcap"):
        found = read(tmp_path / name, day=DAY)
        assert form_of(tmp_path / name) == "ASTERIX" and found.kind == "polar"
        assert [found.sensors[i].name for i in found.sensor] == ["100/19", "100/19", "100/19", "100/1"]
        assert found.start == datetime(2024, 5, 1, 23, 59, 57, tzinfo=UTC) and found.time.tolist()[:3] == [
            0,
            3.5,
            4,
        ]
        np.testing.assert_allclose(found.z[:, 0] / 1852, [10, 10.3, 10.5, 10.5], atol=0.01)
        np.testing.assert_allclose(np.degrees(found.z[:, 1]), [45, 44.5, 44, 44], atol=0.01)
        assert [scan.rows.tolist() for scan in cut(found)] == [[0, 1], [2], [3]]
        assert found.metadata["aircraft_address"] == ["3c660c", "", "", ""]
        assert found.metadata["flight_level"][0] == "330" and found.metadata["mode_3a"][0] == "7700"
        assert found.remarks[-5:] == (
            "1 data blocks of other categories left out", "1 reports without time, range or azimuth dropped",
            "2 north markers cut scans", "2 rows sorted by time", "1 repeats of other rows dropped",
        )  # fmt: skip


def test_a_turn_without_plots_is_a_scan_that_detected_nothing(tmp_path):
    """Turns of 5 s, through midnight, of which the second and the third have no plots; a second radar has
    north markers alone."""
    other = {"010": (("SAC", 1), ("SIC", 1))}
    times = [(86392.0 + 5 * i) % 86400 for i in range(5)]
    blocks = [part for t in times for part in (north(t), north(t, **other))]
    blocks.insert(2, block(48, plot(86394.0, 10, 45)))
    blocks += [block(48, plot(14.0, 11, 45)), north(17.0)]
    (tmp_path / "raw").write_bytes(b"".join(blocks))
    found = read(tmp_path / "raw", day=DAY)
    assert found.time.tolist() == [0, 20] and found.row.tolist() == [1, 2]
    assert "3 turns without reports are scans that detected nothing" in found.remarks
    scans = cut(found)
    assert [scan.rows.tolist() for scan in scans] == [[0], [], [], [], [1]]
    assert [scan.time for scan in scans] == [0, 5.5, 10.5, 15.5, 20]


def test_radars_without_north_markers_are_cut_by_their_period(tmp_path):
    file = tmp_path / "raw"
    file.write_bytes(b"".join(block(48, plot(4.0 * i + i / 50, 10, 7.2 * i)) for i in range(6)))
    assert (read(file).scan == -1).all() and "turn" in read(file).metadata


def test_broken_surveillance_data_are_counted_or_refused(tmp_path, monkeypatch):
    good = block(48, plot(1, 10, 45))
    files = {
        "cut": (good + good[:-1], f"byte {len(good) + 1} begins no whole data block of ASTERIX"),
        "other": (b"\x3e\x00\x04\x00", "no target reports of category 48 with time, range and azimuth"),
        "new": (b"\x0a\x0d\x0d\x0a" + bytes(9), "pcapng; make pcap of it: editcap -F pcap new NAME.pcap"),
        "link": (pcap(good)[:20] + b"\x69\0\0\0" + pcap(good)[24:], "packets of link type 105; known are 1,"),
    }  # fmt: skip
    for name, (data, message) in files.items():
        (tmp_path / name).write_bytes(data)
        refused(message, tmp_path / name)
    (tmp_path / "half").write_bytes(good + b"\x30\x00\x05\xff\xff" + block(48, plot(2, 10, 45)))
    found = read(tmp_path / "half")
    assert len(found.time) == 2 and "1 data blocks not understood left out" in found.remarks
    monkeypatch.setitem(sys.modules, "asterix.base", None)
    refused(
        "ASTERIX needs the extra `asterix`: pip install 'gmr-gym[asterix]'",
        tmp_path / "half",
        error=ImportError,
    )


# Parquet


def test_parquet_is_read_by_its_columns(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    moments = np.array(["2024-05-01T10:00:00", "2024-05-01T10:00:00.25"], "datetime64[ms]")
    table = pyarrow.table(
        {"time": moments, "x_m": [1.0, 2.0], "y_m": [3, 4], "name": ["a", None], "rest": [[1], [2]]}
    )
    parquet.write_table(table, tmp_path / "z.parquet")
    for source in (tmp_path / "z.parquet", table):
        found = read(source, {"id": "name"})
        assert (
            found.z.tolist() == [[1, 3], [2, 4]] and found.time.tolist() == [0, 0.25] and found.start == TEN
        )
        assert found.identity.tolist() == ["a", None] and [*found.metadata] == ["rest"]
    refused(
        "z.parquet: no column 'nam' for --id, did you mean 'name'?", tmp_path / "z.parquet", {"id": "nam"}
    )
    (tmp_path / "cut.parquet").write_bytes((tmp_path / "z.parquet").read_bytes()[:-9])
    refused("cut.parquet: a damaged Parquet file", tmp_path / "cut.parquet")
    data = bytearray((tmp_path / "z.parquet").read_bytes())
    data[8:200] = bytes(192)
    (tmp_path / "cut.parquet").write_bytes(data)
    refused("cut.parquet: a damaged Parquet file", tmp_path / "cut.parquet")
    lists = pyarrow.table({"time_s": [0.0], "x_m": [[1.0, 2.0]], "y_m": [0.0]})
    refused("Table, record 1, column x_m: '[1. 2.]' is not a finite number", lists)


def test_text_in_two_bytes_a_sign_is_no_surveillance_data(tmp_path):
    (tmp_path / "z.csv").write_text("time_s,x_m,y_m\n0,1,2\n", encoding="utf-16-le")
    assert read(tmp_path / "z.csv", encoding="utf-16-le").z.tolist() == [[1, 2]]


def test_parquet_needs_its_extra(tmp_path, monkeypatch):
    (tmp_path / "z.parquet").write_bytes(b"PAR1")
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    refused(
        "Parquet needs the extra `tables`: pip install 'gmr-gym[tables]'",
        tmp_path / "z.parquet",
        error=ImportError,
    )

"""A host of Sparkplug B: paho-mqtt, and protobuf with the messages of the specification (6.4.1).

sparkplug.py PORT GROUP NODE: prints each message as a line of JSON; sends a command for each line NAME KIND VALUE of its input.
"""

import json
import sys

import paho.mqtt.client as mqtt
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FieldDescriptorProto as Field

VALUES = [
    ("int_value", 10, Field.TYPE_UINT32),
    ("long_value", 11, Field.TYPE_UINT64),
    ("float_value", 12, Field.TYPE_FLOAT),
    ("double_value", 13, Field.TYPE_DOUBLE),
    ("boolean_value", 14, Field.TYPE_BOOL),
    ("string_value", 15, Field.TYPE_STRING),
]


def payload_class():
    file = descriptor_pb2.FileDescriptorProto(name="host.proto", package="host", syntax="proto2")

    def message(name, fields, one_of=()):
        own = file.message_type.add(name=name)
        if one_of:
            own.oneof_decl.add(name="value")
        for label, number, kind, *more in [*fields, *one_of]:
            field = own.field.add(name=label, number=number, label=Field.LABEL_OPTIONAL)
            if isinstance(kind, str):
                field.type, field.type_name = Field.TYPE_MESSAGE, ".host." + kind
            else:
                field.type = kind
            if more:
                field.label = Field.LABEL_REPEATED
            if (label, number, kind) in one_of:
                field.oneof_index = 0

    message("Property", [("type", 1, Field.TYPE_UINT32), ("int_value", 3, Field.TYPE_UINT32)])
    message("Properties", [("keys", 1, Field.TYPE_STRING, True), ("values", 2, "Property", True)])
    head = [
        ("name", 1, Field.TYPE_STRING),
        ("timestamp", 3, Field.TYPE_UINT64),
        ("datatype", 4, Field.TYPE_UINT32),
        ("is_null", 7, Field.TYPE_BOOL),
        ("properties", 9, "Properties"),
    ]
    message("Metric", head, VALUES)
    body = [("timestamp", 1, Field.TYPE_UINT64), ("metrics", 2, "Metric", True), ("seq", 3, Field.TYPE_UINT64)]
    message("Payload", body)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("host.Payload"))


Payload = payload_class()
PORT, GROUP, NODE = int(sys.argv[1]), sys.argv[2], sys.argv[3]


def tell(_client, _data, message):
    payload = Payload.FromString(message.payload)
    metrics = {}
    for metric in payload.metrics:
        which = metric.WhichOneof("value")
        quality = dict(zip(metric.properties.keys, (value.int_value for value in metric.properties.values)))
        metrics[metric.name] = {
            "value": getattr(metric, which) if which else None,
            "type": metric.datatype,
            "time": metric.timestamp,
            "null": metric.is_null,
            "quality": quality.get("Quality"),
        }
    told = {"topic": message.topic.split("/")[2], "qos": message.qos, "retained": bool(message.retain)}
    told |= {"seq": payload.seq if payload.HasField("seq") else None, "metrics": metrics}
    print(json.dumps(told), flush=True)


def subscribe(client, *_):
    client.subscribe([(f"spBv1.0/{GROUP}/{kind}/{NODE}", 1) for kind in ("NBIRTH", "NDEATH", "NDATA")])


def ready(*_):
    print(json.dumps({"topic": "ready"}), flush=True)


client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
client.on_message, client.on_connect, client.on_subscribe = tell, subscribe, ready
client.connect("127.0.0.1", PORT)
client.loop_start()
for line in sys.stdin:
    name, kind, value = line.rstrip("\n").rsplit(" ", 2)
    command = Payload(timestamp=1)
    metric = command.metrics.add(name=name)
    setattr(metric, kind, {"true": True, "false": False}.get(value) if kind == "boolean_value" else json.loads(value))
    client.publish(f"spBv1.0/{GROUP}/NCMD/{NODE}", command.SerializeToString())

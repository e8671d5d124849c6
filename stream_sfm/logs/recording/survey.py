"""The content of a log before anything is estimated: topics, counts, duration."""

import msgspec

from ...system.inputs import LIMITS
from ..mcap_file.message import Channel, Damage, Source
from .messages import kind_of


class Topic(msgspec.Struct):
    """One topic. `kind` as in `messages.kind_of`; `count` of messages, None if it is not known."""

    name: str
    kind: str
    schema: str
    encoding: str
    count: int | None
    metadata: dict[str, str]  # what the recorder of its first channel says about it


class Survey(msgspec.Struct):
    """The topics by name, and the span of log times."""

    topics: dict[str, Topic]
    start_ns: int = 0
    end_ns: int = 0
    whole: bool = True  # false: the scan ended early, so counts and span are lower bounds

    def of_kind(self, *kinds: str) -> dict[str, int | None]:
        """Topic -> count for the topics of these kinds."""
        return {t.name: t.count for t in self.topics.values() if t.kind in kinds}

    def add(self, channel: Channel, count: int | None, damage: Damage) -> Topic | None:
        """Add messages of a channel to its topic; None if it is beyond the limits."""
        name = channel.topic
        if (topic := self.topics.get(name)) is None:
            if len(self.topics) >= LIMITS.named or max(len(name), len(channel.schema_name)) > LIMITS.name:
                damage.note(f"only {LIMITS.named} topics with names of up to {LIMITS.name} characters are used")
                return None
            kind = kind_of(channel.schema_name)
            topic = self.topics[name] = Topic(
                name, kind, channel.schema_name, channel.message_encoding, count, dict(channel.metadata)
            )
        elif count is not None:
            topic.count = (topic.count or 0) + count
        return topic


def survey_log(source: Source, damage: Damage) -> Survey:
    """Survey a log by its index if that can be trusted, else by reading it in order."""
    if (contents := source.contents()) is None:
        return _scan(source, damage)
    survey = Survey({}, contents.start_ns, contents.end_ns)
    for channel, count in contents.channels:
        survey.add(channel, count, damage)
    return survey


def _scan(source: Source, damage: Damage) -> Survey:
    survey = Survey({})
    for message in source.messages(damage):
        if survey.add(message.channel, 1, damage) is None:
            continue
        survey.start_ns = min(survey.start_ns or message.log_time_ns, message.log_time_ns)
        survey.end_ns = max(survey.end_ns, message.log_time_ns)
        long = damage.bytes_read > LIMITS.scanned_bytes
        if long and all(len(survey.of_kind(kind)) > 1 for kind in ("image", "calibration")):
            survey.whole = False
            break
    return survey

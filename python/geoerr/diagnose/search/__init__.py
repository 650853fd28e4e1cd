"""What may be missing, looked for: one look at everything, the best added, another look, until chance explains it."""

from geoerr.diagnose.search.alike import other_periods
from geoerr.diagnose.search.asked_for import AskedFor
from geoerr.diagnose.search.bench import Bench
from geoerr.diagnose.search.judged import Judged, channel_of, reference_of
from geoerr.diagnose.search.left import why_left
from geoerr.diagnose.search.look import Round, look
from geoerr.diagnose.search.rivals import Found, Rival
from geoerr.diagnose.search.rounds import Searched, search
from geoerr.diagnose.search.settle import Settled, settle
from geoerr.diagnose.search.waves_seen import waves_seen

__all__ = [
    "AskedFor",
    "Bench",
    "Found",
    "Judged",
    "Rival",
    "Round",
    "Searched",
    "Settled",
    "channel_of",
    "look",
    "other_periods",
    "reference_of",
    "search",
    "settle",
    "waves_seen",
    "why_left",
]

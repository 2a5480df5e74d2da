"""The bench: campaigns, their store, the verbs and what people look at."""

import os

# before numpy is loaded: the simulator solves thousands of systems of six, which a second thread only delays
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

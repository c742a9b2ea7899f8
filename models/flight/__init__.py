"""The flown loop judged: margins with the thrust on."""

"""What the paper's tables and figures share: labs, campaigns, learners, searches, measurements, drawing."""

"""compensate"""
